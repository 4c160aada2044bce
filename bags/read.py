"""One door for everything that can be recovered from: MCAP file, rosbag2 folder, video file, folder of images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import Bounded, Stamped
from diffphys_ros.bags.decode import decode_compressed, decode_image
from diffphys_ros.bags.filmed import clip_of
from diffphys_ros.bags.gravity import Imu
from diffphys_ros.bags.rig import FRAME, Channel, Received
from diffphys_ros.bags.storage import BAG_SUFFIXES, METADATA, Bag, existing, open_bag
from diffphys_ros.bags.thinned import chosen, nearest, said
from diffphys_ros.bags.topics import choose_imu, choose_topics, depth_info, image_topics
from diffphys_ros.bags.transforms import MOVING, STATIC, Transforms
from diffphys_ros.bags.video import read_images, read_video
from diffphys_ros.config import FrameSettings, Settings
from diffphys_ros.errors import InputError, listed, named, shown
from diffphys_ros.types import Clip

TF_MESSAGE = "tf2_msgs/msg/TFMessage"
MARGIN_NS = 10**9  # of transforms and accelerations before the first and after the last image
MOST_REASON = 300  # characters: an image's own words stand in it


def read_clip(path: str | Path, settings: Settings, *, start_s: float = 0.0, duration_s: float | None = None, frames: FrameSettings | None = None) -> Clip:
    """The clip in an .mcap or .db3 file, a rosbag2 folder, a video file or a folder of images.

    Settings used: topics.*, camera.fov_deg (where there is no camera_info), camera.fps (image folders; overrides a video's own), sync.*,
    scene.target_frame and what of scene.* speaks of the world. Of a recording the first `start_s` can be left out and no more than
    `duration_s` taken [s]; `frames` says which frames to keep back, of which nothing but the stamps is looked at.
    Raises InputError with one sentence for everything that cannot be read.
    """
    path = existing(path)
    if path.suffix == ".bag":
        raise InputError(f"{shown(path)}: a ROS 1 bag, ROS 2 recordings are read; convert it with 'rosbags-convert'")
    if is_bag(path):
        with open_bag(path) as bag:
            return _read_bag(bag, settings, shown(path), window(bag, start_s, duration_s, shown(path)), frames)
    if start_s or duration_s:
        raise InputError(f"{shown(path)}: is no recording, of which alone a part can be read; leave start and duration out")
    if settings.scene.target_frame not in (None, FRAME):
        raise InputError(f"{shown(path)}: scene.target_frame is {named(settings.scene.target_frame)}, but pictures carry no transforms; leave it out, or set it to {FRAME}")
    return read_images(path, settings, frames) if path.is_dir() else read_video(path, settings, frames)


def window(bag: Bag, start_s: float, duration_s: float | None, source: str) -> tuple[int, int]:
    """Log times [ns] between which a recording is read. Raises InputError where it holds nothing there."""
    begin, end = bag.span
    first = begin + round(start_s * 1e9)
    if first >= end:
        raise InputError(f"{source}: start {start_s:g} s lies behind its end, it lasts {(end - begin) * 1e-9:.4g} s; choose an earlier start")
    return first, min(end, first + round(duration_s * 1e9)) if duration_s else end


def is_bag(path: Path) -> bool:
    """Whether a path is a recording, which carries a camera_info, rather than bare pictures."""
    return path.suffix in BAG_SUFFIXES or (path / METADATA).exists()


def _read_bag(bag: Bag, settings: Settings, source: str, span: tuple[int, int], frames: FrameSettings | None) -> Clip:
    image_topic, depth_topic, info_topic = choose_topics(bag, settings.topics, source)
    wanted, wanted_depth, thinned = _thinned(bag, image_topic, depth_topic, span, 1 if frames is None else frames.every, source)
    images, frame_id, notes = _read_topic(bag, image_topic, source, "image", span, wanted)
    if not images:
        raise InputError(f"{source}: topic {named(image_topic)} holds no image between start and the end of duration; choose another part")
    depths, depth_frame, found = _read_topic(bag, depth_topic, source, "depth", span, wanted_depth) if depth_topic else ([], "", [])
    colour = _channel(bag, image_topic, info_topic, images, frame_id)
    depth = _channel(bag, depth_topic, depth_info(bag, depth_topic, image_topic), depths, depth_frame) if depth_topic and depths else None
    stamps = [stamp for stamp, _ in images]
    imu = _imu(bag, settings, (min(stamps) - MARGIN_NS, max(stamps) + MARGIN_NS), source)
    received = Received(source, stamps, colour, depth, _transforms(bag, source), imu)
    return clip_of(received, settings, images, depths, _masks(bag, settings.topics.mask, source), [*notes, *found, *thinned], frames)


def _thinned(bag: Bag, topic: str, depth_topic: str | None, span: tuple[int, int], every: int, source: str) -> tuple[set[int] | None, set[int] | None, list[str]]:
    """Which messages of both topics are taken, by their number in the recording, None for all; and a note. Nothing is decoded."""
    if every == 1:
        return None, None, []
    stamps, times = ([_stamp(m) or log_ns for _, log_ns, m in bag.messages([name], *span)] if name else [] for name in (topic, depth_topic))
    kept = chosen(stamps, every, source)
    return set(kept), set(nearest(times, [stamps[i] for i in kept])), said(every, len(kept), len(stamps))


def _channel(bag: Bag, topic: str, info_topic: str | None, images: Stamped, frame_id: str) -> Channel:
    infos = [(_stamp(info) or log_ns, info) for _, log_ns, info in bag.messages([info_topic])] if info_topic else []
    size = images[0][1].shape[1], images[0][1].shape[0]
    return Channel(topic, size, frame_id, sorted(infos, key=lambda item: item[0]), info_topic or "camera_info")


def _imu(bag: Bag, settings: Settings, span: tuple[int, int], source: str) -> Imu | None:
    """What the IMU of a recording measured during the clip, without which before and after it; None where none is wanted or there."""
    topic = choose_imu(bag, settings.topics, source)
    if topic is None:
        return None
    heard = [(_stamp(message) or log_ns, message) for _, log_ns, message in bag.messages([topic])]
    during = [message for stamp, message in heard if span[0] <= stamp <= span[1]]
    return Imu(topic, during or [message for _, message in heard])


def _masks(bag: Bag, topic: str | None, source: str) -> Stamped:
    """(stamp [ns], label image uint8 (H, W)) of a topic; empty where none is wanted."""
    if topic is None:
        return []
    if topic not in image_topics(bag):
        raise InputError(
            f"{source}: topics.mask is '{named(topic)}', must be one of {listed(sorted(image_topics(bag)), 4) or 'none (there are no image topics)'}"
        )
    masks, _, _ = _read_topic(bag, topic, source, "mask")
    if not masks:
        raise InputError(f"{source}: topic {named(topic)} holds no message, needs a label image of frame 0; name another with topics.mask")
    return [(stamp, image[..., 0]) for stamp, image in masks]


def _read_topic(
    bag: Bag, topic: str, source: str, setting: str, span: tuple[int, int] | None = None, wanted: set[int] | None = None
) -> tuple[list[tuple[int, np.ndarray]], str, list[str]]:
    """(stamp [ns], image) of a topic in the order of the recording, of the `wanted` messages alone (by number; all where None), the images'
    frame, and notes."""
    images, unstamped, frame_id = Bounded(source), False, ""
    dimensions, what = (2, "depth (16UC1 in mm or 32FC1 in m)") if setting == "depth" else (3, "colour" if setting == "image" else "8-bit label")
    for number, (_, log_ns, message) in enumerate(bag.messages([topic], *(span or ()))):
        if wanted is not None and number not in wanted:
            continue
        image = decoded(message, source, topic, colour=setting != "depth")
        if image.ndim != dimensions:
            raise InputError(f"{source}: topic {named(topic)} holds no {what} images; name another with topics.{setting}")
        stamp = _stamp(message)
        unstamped |= not stamp
        frame_id = frame_id or message.header.frame_id
        images.add(stamp or log_ns, image)
    return images.taken, frame_id, [f"images of {named(topic)} carry no stamp; the times of recording are used"] if unstamped else []


def _stamp(message: Any) -> int:
    """Of the header [ns]; 0 where it was not filled in."""
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def decoded(message: Any, source: str, topic: str, *, colour: bool = False) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of a sensor_msgs/Image or CompressedImage; grey of 16 bits is depth unless `colour` is
    wanted. Raises InputError, naming the topic."""
    try:
        if hasattr(message, "format"):
            return decode_compressed(message.format, message.data, colour=colour)
        return decode_image(message.encoding, message.height, message.width, message.step, message.is_bigendian, message.data, colour=colour)
    except InputError as error:
        raise InputError(f"{source}: topic {named(topic)}: {named(error, MOST_REASON)}") from error


def _transforms(bag: Bag, source: str) -> Transforms:
    transforms = Transforms()
    for kind in (STATIC, MOVING):
        topic_type = bag.types.get(kind, TF_MESSAGE)
        if topic_type != TF_MESSAGE:
            raise InputError(f"{source}: topic {kind} holds {named(topic_type)}, must hold {TF_MESSAGE}; record it again, or leave the topic out")
        for _, _, message in bag.messages([kind]):
            for link in message.transforms:
                transforms.add(link, kind)
    return transforms
