"""What a message of a clip must be: looked at before it is kept, so that a bad one costs itself alone."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from diffphys_ros.bags.camera import camera_from_info
from diffphys_ros.bags.decode import check_image, decode_image, is_depth
from diffphys_ros.bags.encodings import may_be_colour, metres
from diffphys_ros.bags.read import decoded
from diffphys_ros.bags.transforms import HELD, Transforms, pose_of
from diffphys_ros.bags.world import require_world
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError, short
from diffphys_ros.types import Camera, Clip

from .convert import stamp_ns
from .limits import MAX_FRAMES

MOST_GRAVITY_M_S2 = 100.0
SECOND_NS = 10**9
LABEL_ENCODINGS = ("mono8", "8UC1")


def check(topic: str, message: Any, name: str) -> None:
    """Raises InputError, with the resolved name of the topic, where a message of clip/* cannot be part of a clip."""
    if message.header.stamp.nanosec >= SECOND_NS:
        raise InputError(f"topic {name}: its stamp has {message.header.stamp.nanosec} ns beside the seconds, must be below {SECOND_NS}; stamp it with a time")
    _CHECKS[topic](message, name)


def check_colour(message: Any, topic: str) -> None:
    """Raises InputError where a sensor_msgs/Image is no colour image."""
    _check(message, topic)
    if not may_be_colour(message.encoding):
        raise InputError(f"topic {topic}: encoding is {short(message.encoding)}, must be a colour such as rgb8; publish colour images")


def check_depth(message: Any, topic: str) -> None:
    """Raises InputError where a sensor_msgs/Image is neither a depth image nor empty."""
    if message.height and not is_depth(message.encoding):
        raise InputError(f"topic {topic}: encoding is {short(message.encoding)}, must be 16UC1 or 32FC1; publish depth images")
    _check(message, topic, empty=True)


def check_labels(message: Any, topic: str) -> None:
    """Raises InputError where a sensor_msgs/Image is no label image."""
    if message.encoding not in LABEL_ENCODINGS:
        raise InputError(f"topic {topic}: encoding is {short(message.encoding)}, must be mono8; publish label images")
    _check(message, topic)


def labels_of(message: Any, topic: str) -> np.ndarray:
    """Label image uint8 (H, W) of a sensor_msgs/Image. Raises InputError, naming the topic, where it is none."""
    check_labels(message, topic)
    return np.ascontiguousarray(decoded(message, "topics", topic)[..., 0])


def colour_of(message: Any, topic: str) -> np.ndarray:
    """RGB uint8 (H, W, 3) of a sensor_msgs/Image. Raises InputError, naming the topic, where it is none."""
    check_colour(message, topic)
    return decoded(message, "topics", topic, colour=True)


def array_of(message: Any) -> np.ndarray:
    """RGB uint8 (H, W, 3) or depth [m] float32 (H, W) of a sensor_msgs/Image, over its own bytes where they are that. Raises InputError."""
    height, width = message.height, message.width
    if message.encoding == "rgb8" and message.step == 3 * width and len(message.data) == 3 * width * height:
        return np.frombuffer(message.data, np.uint8).reshape(height, width, 3)
    if message.encoding == "32FC1" and not message.is_bigendian and message.step == 4 * width and len(message.data) == 4 * width * height:
        depth = np.frombuffer(message.data, np.dtype("<f4")).reshape(height, width)
        return depth if np.isfinite(depth).all() and not np.signbit(depth).any() else metres(depth)
    return decode_image(message.encoding, message.height, message.width, message.step, message.is_bigendian, message.data)


def camera_of(info: Any, pose: Any) -> Camera:
    """The camera of clip/camera_info and clip/camera_pose. Raises InputError where they make none."""
    frame_id = info.header.frame_id
    known = Transforms()
    if pose.child_frame_id != pose.header.frame_id:
        known.add(pose, HELD)
    root = known.root(frame_id)
    return camera_from_info(info.k, info.d, info.width, info.height, frame_id, known.between(root, frame_id), root)


def in_world(clip: Clip, settings: Settings) -> Clip:
    """The clip, where it is in the world that the settings speak of. Raises InputError where it is in another."""
    require_world(clip.camera, settings.scene, clip.source)
    return clip


def gravity_of(message: Any) -> np.ndarray | None:
    """Gravity [m/s^2] (3,) of clip/gravity; None where it is not known."""
    vector = np.array([message.vector.x, message.vector.y, message.vector.z])
    return vector if vector.any() else None


def stamps_of(end: Any) -> tuple[int, ...]:
    """Stamps of the images that a clip/end announces [ns]."""
    return tuple(stamp_ns(pose) for pose in end.poses)


def _check(message: Any, topic: str, *, empty: bool = False) -> None:
    if empty and not message.height:
        return
    try:
        check_image(message.encoding, message.height, message.width, message.step, len(message.data))
    except InputError as error:
        raise InputError(f"topic {topic}: {error}") from error


def _check_frame(message: Any, topic: str) -> None:
    check_colour(message, topic)
    if is_depth(message.encoding):
        raise InputError(f"topic {topic}: encoding is {short(message.encoding)}, must be rgb8; publish what ingest_node publishes")


def _check_first_mask(message: Any, topic: str) -> None:
    if message.height:
        check_labels(message, topic)


def _check_info(message: Any, topic: str) -> None:
    try:
        camera_from_info(message.k, message.d, message.width, message.height, message.header.frame_id)
    except InputError as error:
        raise InputError(f"topic {topic}: {error}") from error
    if not message.width or not message.height:
        raise InputError(f"topic {topic}: is for {message.width}x{message.height} px, must be for the size of the clip's images; fill in width and height")


def _check_pose(message: Any, topic: str) -> None:
    try:
        pose_of(message)
    except InputError as error:
        raise InputError(f"topic {topic}: {error}") from error


def _check_gravity(message: Any, topic: str) -> None:
    vector = gravity_of(message)
    if vector is not None and not np.abs(vector).max() <= MOST_GRAVITY_M_S2:  # false for NaN
        raise InputError(f"topic {topic}: is {vector.tolist()} m/s^2, must be within {MOST_GRAVITY_M_S2:g}; publish 0 0 0 where it is not known")


def _check_end(message: Any, topic: str) -> None:
    if not 0 < len(message.poses) <= MAX_FRAMES:
        raise InputError(f"topic {topic}: announces {len(message.poses)} images, must be 1 .. {MAX_FRAMES}; publish a pose for every image of the clip")
    stamps = stamps_of(message)
    if stamps[0] != stamp_ns(message) or any(a >= b for a, b in pairwise(stamps)):
        raise InputError(f"topic {topic}: its stamps must ascend from that of its header; publish those of the clip's images in order")


_CHECKS: dict[str, Callable[[Any, str], None]] = {
    "clip/camera_info": _check_info,
    "clip/camera_pose": _check_pose,
    "clip/gravity": _check_gravity,
    "clip/first_mask": _check_first_mask,
    "clip/image": _check_frame,
    "clip/depth": check_depth,
    "clip/mask": check_labels,
    "clip/end": _check_end,
}
