"""One door for everything that can be recovered from: MCAP file, rosbag2 folder, video file, folder of images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import Bounded, Stamped, assemble
from diffphys_ros.bags.camera import Edges, camera_from_fov, camera_from_info, matrix_from_transform, pose_in_root, undistorter
from diffphys_ros.bags.decode import decode_compressed, decode_image
from diffphys_ros.bags.storage import METADATA, Bag, existing, open_bag
from diffphys_ros.bags.topics import choose_topics, image_topics
from diffphys_ros.bags.video import read_images, read_video
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError, listed, named, shown
from diffphys_ros.types import Camera, Clip

TF_STATIC, TF_MESSAGE = "/tf_static", "tf2_msgs/msg/TFMessage"
MOST_REASON = 300  # characters: an image's own words stand in it
BAG_SUFFIXES = (".mcap", ".db3")


def read_clip(path: str | Path, settings: Settings, *, start_s: float = 0.0, duration_s: float | None = None) -> Clip:
    """The clip in an .mcap or .db3 file, a rosbag2 folder, a video file or a folder of images.

    Settings used: topics.*, camera.fov_deg (where there is no camera_info), camera.fps (image folders; overrides a video's own).
    Of a recording the first `start_s` can be left out and no more than `duration_s` taken [s].
    Raises InputError with one sentence for everything that cannot be read.
    """
    path = existing(path)
    if path.suffix == ".bag":
        raise InputError(f"{shown(path)}: a ROS 1 bag, ROS 2 recordings are read; convert it with 'rosbags-convert'")
    if is_bag(path):
        with open_bag(path) as bag:
            return _read_bag(bag, settings, shown(path), window(bag, start_s, duration_s, shown(path)))
    if start_s or duration_s:
        raise InputError(f"{shown(path)}: is no recording, of which alone a part can be read; leave start and duration out")
    return read_images(path, settings) if path.is_dir() else read_video(path, settings)


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


def _read_bag(bag: Bag, settings: Settings, source: str, span: tuple[int, int]) -> Clip:
    image_topic, depth_topic, info_topic = choose_topics(bag, settings.topics, source)
    images, frame_id, notes = _read_topic(bag, image_topic, source, "image", span)
    if not images:
        raise InputError(f"{source}: topic {named(image_topic)} holds no image between start and the end of duration; choose another part")
    depths, _, depth_notes = _read_topic(bag, depth_topic, source, "depth", span) if depth_topic else ([], "", [])
    info = bag.first(info_topic) if info_topic else None
    view = (images[0][1].shape[1], images[0][1].shape[0], frame_id)
    tree = _static_transforms(bag, source)
    camera, undistort, found = seen_through(info, tree, settings, view, source, image_topic=image_topic, info_topic=info_topic)
    mask = _first_mask(bag, settings.topics.mask, images[0][0], source)
    if undistort:
        mask = None if mask is None else undistort(mask)
        images, depths = ([(stamp, undistort(image)) for stamp, image in some] for some in (images, depths))
    return replace(assemble(images, depths, camera, source, notes=[*notes, *depth_notes, *found]), first_labels=mask)


def _first_mask(bag: Bag, topic: str | None, stamp: int, source: str) -> np.ndarray | None:
    """The label image uint8 (H, W) of a topic nearest in time to frame 0; None where none is wanted."""
    if topic is None:
        return None
    if topic not in image_topics(bag):
        raise InputError(
            f"{source}: topics.mask is '{named(topic)}', must be one of {listed(sorted(image_topics(bag)), 4) or 'none (there are no image topics)'}"
        )
    masks, _, _ = _read_topic(bag, topic, source, "mask")
    if not masks:
        raise InputError(f"{source}: topic {named(topic)} holds no message, needs a label image of frame 0; name another with topics.mask")
    return nearest(masks, stamp)[..., 0]


def nearest(images: Stamped, stamp: int) -> np.ndarray:
    """The one of stamped images that is nearest in time to a stamp [ns]."""
    return min(images, key=lambda item: abs(item[0] - stamp))[1]


def _read_topic(bag: Bag, topic: str, source: str, setting: str, span: tuple[int, int] | None = None) -> tuple[list[tuple[int, np.ndarray]], str, list[str]]:
    """(stamp [ns], image) of a topic in the order of the recording, the images' frame, and notes."""
    images, unstamped, frame_id = Bounded(source), False, ""
    dimensions, what = (2, "depth (16UC1 in mm or 32FC1 in m)") if setting == "depth" else (3, "colour" if setting == "image" else "8-bit label")
    for _, log_ns, message in bag.messages([topic], *(span or ())):
        image = decoded(message, source, topic)
        if image.ndim != dimensions:
            raise InputError(f"{source}: topic {named(topic)} holds no {what} images; name another with topics.{setting}")
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        unstamped |= not stamp
        frame_id = frame_id or message.header.frame_id
        images.add(stamp or log_ns, image)
    return images.taken, frame_id, [f"images of {named(topic)} carry no stamp; the times of recording are used"] if unstamped else []


def decoded(message: Any, source: str, topic: str) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of a sensor_msgs/Image or CompressedImage. Raises InputError, naming the topic."""
    try:
        if hasattr(message, "format"):
            return decode_compressed(message.format, message.data)
        return decode_image(message.encoding, message.height, message.width, message.step, message.is_bigendian, message.data)
    except InputError as error:
        raise InputError(f"{source}: topic {named(topic)}: {named(error, MOST_REASON)}") from error


def seen_through(
    info: Any, edges: Edges, settings: Settings, view: tuple[int, int, str], source: str, *, image_topic: str, info_topic: str | None
) -> tuple[Camera, Callable[[np.ndarray], np.ndarray] | None, list[str]]:
    """The camera of a recording or of live topics, what removes its distortion (or None), and notes.

    Args:
        info: sensor_msgs/CameraInfo or None. edges: static transforms, see `pose_in_root`.
        view: width, height [px] and frame of the images.

    Raises InputError for a camera_info that is missing (without camera.fov_deg), unusable or for other images.
    """
    width, height, frame_id = view
    frame_id = frame_id or (info.header.frame_id if info else "") or "camera_optical_frame"
    pose, root = pose_in_root(edges, frame_id)
    fov = settings.camera.fov_deg
    if info is None or (info.k[0] == 0 and fov):
        if fov is None:
            raise InputError(f"{source}: has no camera_info; record the camera_info topic or set camera.fov_deg")
        note = f"no usable camera_info: camera.fov_deg {fov:g} and no lens distortion are taken"
        return camera_from_fov(fov, width, height, frame_id, pose, root), None, [note]
    if info.width and (info.width, info.height) != (width, height):
        raise InputError(
            f"{source}: {named(info_topic)} is for {info.width}x{info.height} px, the images of {named(image_topic)} have {width}x{height} px; "
            "name the right topic with topics.camera_info"
        )
    # rectified images share their camera_info with the raw ones; p is theirs
    rectified = "rect" in image_topic.removesuffix("/compressed").rsplit("/", 1)[-1]
    k, d = (np.reshape(info.p, (3, 4))[:, :3], np.zeros(0)) if rectified and np.any(info.p) else (info.k, info.d)
    try:
        camera = camera_from_info(k, d, width, height, frame_id, pose, root)
        undistort = undistorter(k, d, info.distortion_model, width, height)
    except InputError as error:
        raise InputError(f"{source}: topic {named(info_topic)}: {error}") from error
    return camera, undistort, ["lens distortion was removed from the images"] if undistort else []


def _static_transforms(bag: Bag, source: str) -> dict[str, tuple[str, np.ndarray]]:
    kind = bag.types.get(TF_STATIC, TF_MESSAGE)
    if kind != TF_MESSAGE:
        raise InputError(f"{source}: topic {TF_STATIC} holds {named(kind)}, must hold {TF_MESSAGE}; record it again, or leave the topic out")
    links = [link for _, _, message in bag.messages([TF_STATIC]) for link in message.transforms]
    return dict(edge(link) for link in links)


def edge(link: Any) -> tuple[str, tuple[str, np.ndarray]]:
    """Child frame, (parent frame, parent_from_child (4, 4) [m]) of a geometry_msgs/TransformStamped."""
    t, r = link.transform.translation, link.transform.rotation
    try:
        return link.child_frame_id, (link.header.frame_id, matrix_from_transform((t.x, t.y, t.z), (r.x, r.y, r.z, r.w)))
    except InputError as error:
        raise InputError(f"{named(link.child_frame_id)} in {named(link.header.frame_id)}: {error}") from error
