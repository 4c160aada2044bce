"""What a sensor_msgs/CameraInfo says of the images of a topic: their pinhole camera once lens distortion is removed.

K, D, R and P are those of the full picture of the sensor: a region of interest moves the optical axis, binning then divides all by the
bin's size, about the outer corner of the picture (a bin's centre lies between its pixels).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from diffphys_ros.bags.camera import camera_from_info, undistorter
from diffphys_ros.errors import InputError, named

SAME_PX = 0.01  # of focal lengths and optical axes that are equal but for rounding
Size = tuple[int, int]  # width, height [px]


@dataclass(frozen=True)
class Lens:
    """The camera of the images of a topic."""

    matrix: np.ndarray  # intrinsic, of the undistorted images [px], (3, 3)
    undistort: Callable[[np.ndarray], np.ndarray] | None  # of a colour or depth image; None where there is no distortion
    size: Size
    notes: tuple[str, ...] = ()

    def sees_like(self, other: Lens) -> bool:
        """Whether undistorted images of both have the same rays in the same pixels, up to rounding."""
        return self.size == other.size and bool(np.abs(self.matrix - other.matrix).max() < SAME_PX)


def is_rectified(topic: str) -> bool:
    """Whether a topic's name says, as image_proc has it, that its images are rectified: image_rect, image_rect_color, image_rectified."""
    base = topic.removesuffix("/compressed").removesuffix("/compressedDepth").rsplit("/", 1)[-1]
    return any(word in ("rect", "rectified") for word in base.lower().split("_"))


def lens_of(info: Any, size: Size, topic: str) -> Lens:
    """The lens behind the images of a topic.

    Args:
        info: sensor_msgs/CameraInfo. size: width, height of the images [px]. topic: resolved name; that of rectified images has
            `rect` among its words, their camera is P and they are left as they are.

    Raises InputError where the camera_info is for other images, or is that of no camera (see `camera_from_info` and `undistorter`).
    """
    left_top, bins = _crop(info, size, topic)
    projected = np.reshape(np.asarray(info.p, float), (3, 4)) if np.any(info.p) else None
    turn = np.reshape(np.asarray(info.r, float), (3, 3))
    if is_rectified(topic) and projected is None and np.any(info.d):
        raise InputError(f"camera_info has no P, which the rectified images of {named(topic)} need; have the driver fill it in, or record the raw images")
    if is_rectified(topic) and projected is not None:
        matrix = _cropped(projected[:, :3], left_top, bins)
        camera_from_info(matrix, [], *size, "")
        return Lens(matrix, None, size, _beside(projected))
    matrix = _cropped(np.reshape(np.asarray(info.k, float), (3, 3)), left_top, bins)
    camera = camera_from_info(matrix, info.d, *size, "")
    turned = np.any(turn) and np.abs(turn - np.eye(3)).max() > 1e-9
    undistort = undistorter(matrix, info.d, info.distortion_model, *size, turn=turn if turned else None)
    said = ["lens distortion was removed from the images"] if undistort and np.any(info.d) else []
    said += ["the images were turned by the rectification R of camera_info"] if undistort and turned else []
    return Lens(camera.pixel_from_camera, undistort, size, tuple(said))


def image_size(info: Any) -> Size:
    """Width and height [px] of the images that a camera_info is for, after region of interest and binning; zeros where it does not say."""
    roi = info.roi
    whole = (roi.width or info.width, roi.height or info.height)
    return whole[0] // max(info.binning_x, 1), whole[1] // max(info.binning_y, 1)


def calibration(info: Any) -> tuple[Any, ...]:
    """All of a camera_info that says something of the camera; equal for messages that say the same."""
    roi = info.roi
    crop = (roi.x_offset, roi.y_offset, roi.width, roi.height, info.binning_x, info.binning_y)
    return info.header.frame_id, info.distortion_model, info.width, info.height, *crop, *(tuple(map(float, each)) for each in (info.k, info.d, info.r, info.p))


def _crop(info: Any, size: Size, topic: str) -> tuple[tuple[int, int], tuple[int, int]]:
    """Offset of the images in the full picture [px], and size of a bin [px]. Raises InputError where the camera_info is for images of another size."""
    if not info.width or not info.height:
        return (0, 0), (1, 1)
    if image_size(info) != size:
        raise InputError(
            f"is for {info.width}x{info.height} px{_cut(info)}, the images of {named(topic)} have {size[0]}x{size[1]} px; "
            "name the right topic with topics.camera_info, or correct the driver"
        )
    return (info.roi.x_offset, info.roi.y_offset), (max(info.binning_x, 1), max(info.binning_y, 1))


def _cut(info: Any) -> str:
    """Region of interest and binning in words."""
    roi, bins = info.roi, (max(info.binning_x, 1), max(info.binning_y, 1))
    region = f", region of interest {roi.width}x{roi.height} px" if roi.width or roi.height else ""
    return region + (f", bins of {bins[0]}x{bins[1]} px" if max(bins) > 1 else "")


def _cropped(matrix: np.ndarray, left_top: tuple[int, int], bins: tuple[int, int]) -> np.ndarray:
    """An intrinsic matrix of the full picture for a part of it whose pixels are bins."""
    result = matrix.astype(float).copy()
    for i in (0, 1):
        result[i, 2] -= left_top[i]
        if bins[i] > 1:
            result[i, 2] = (result[i, 2] + 0.5) / bins[i] - 0.5
            result[i, :2] /= bins[i]
    return result


def _beside(projection: np.ndarray) -> tuple[str, ...]:
    """A note where a projection matrix (3, 4) is that of a stereo pair's second camera."""
    beside = -projection[0, 3] / projection[0, 0] if projection[0, 0] else 0.0
    if not beside:
        return ()
    return (f"P of camera_info is that of a stereo pair's second camera, {beside:.3g} m beside the first: the images' frame is taken as the second one's own",)
