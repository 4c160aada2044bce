"""Pictures without distortion, beside the pinhole camera that took them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..types import Camera
from .structure import Placed, read_image


@dataclass(frozen=True)
class Shot:
    """One undistorted picture."""

    name: str
    image: np.ndarray  # RGB, uint8, shape (H, W, 3)
    valid: np.ndarray  # bool, shape (H, W): false where the lens saw nothing
    camera: Camera
    seen: np.ndarray  # sparse points that it shows, indices, shape (K,)


def shot_of(name: str, image: np.ndarray, camera: Camera, distortion: np.ndarray, seen: np.ndarray) -> Shot:
    """The picture (H, W, 3) with its distortion (k1 k2 p1 p2) removed; the intrinsics stay."""
    valid = np.full(image.shape[:2], 255, np.uint8)
    if distortion.any():
        maps = cv2.initUndistortRectifyMap(camera.pixel_from_camera, distortion, None, camera.pixel_from_camera, valid.shape[::-1], cv2.CV_32FC1)
        image, valid = cv2.remap(image, *maps, cv2.INTER_LINEAR), cv2.remap(valid, *maps, cv2.INTER_LINEAR)
    return Shot(name, image, valid == 255, camera, seen)


def shot(placed: Placed, folder: Path) -> Shot:
    """The undistorted picture of a folder that found its place."""
    return shot_of(placed.name, read_image(folder / placed.name), placed.camera, placed.distortion, placed.seen)


def moved(camera: Camera, similarity: np.ndarray, world_frame_id: str = "") -> Camera:
    """The camera after a similarity (4, 4) of the world."""
    scale = np.cbrt(np.linalg.det(similarity[:3, :3]))
    pose = similarity @ camera.world_from_camera
    pose[:3, :3] /= scale
    return replace(camera, world_from_camera=pose, world_frame_id=world_frame_id or camera.world_frame_id)
