"""Cameras from camera_info or a field of view, undistortion, and poses from transform trees."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike

from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera

ASSUMED_FOV_DEG = 50.0
Edges = Mapping[str, tuple[str, np.ndarray]]  # child frame -> parent frame, parent_from_child (4, 4)


def camera_from_info(
    k: ArrayLike,
    d: ArrayLike,
    width: int,
    height: int,
    frame_id: str,
    world_from_camera: np.ndarray | None = None,
    world_frame_id: str = "",
) -> Camera:
    """The pinhole camera of a camera_info, after undistortion (see `undistorter`).

    Args:
        k: intrinsic matrix [px], 9 numbers. d: distortion coefficients, any number. width, height: of the images [px].
        world_from_camera: rigid transform (4, 4) [m]; without one the camera's own frame is the world.

    Raises InputError where k[0] is 0 or a number is not finite.
    """
    matrix = np.asarray(k, float).reshape(3, 3)
    if not np.isfinite(matrix).all() or not np.isfinite(np.asarray(d, float)).all():
        raise InputError("camera_info holds numbers that are not finite; calibrate the camera")
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise InputError(
            f"camera_info has focal length K[0] = {matrix[0, 0]:g}, must be above 0; calibrate the camera or set camera.fov_deg"
        )
    return _camera(matrix, width, height, frame_id, world_from_camera, world_frame_id)


def camera_from_fov(
    fov_deg: float,
    width: int,
    height: int,
    frame_id: str = "camera_optical_frame",
    world_from_camera: np.ndarray | None = None,
    world_frame_id: str = "",
) -> Camera:
    """The pinhole camera with square pixels, a centred optical axis and a horizontal field of view [deg]."""
    focal = width / 2 / math.tan(math.radians(fov_deg) / 2)
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    return _camera(matrix, width, height, frame_id, world_from_camera, world_frame_id)


def undistorter(k: ArrayLike, d: ArrayLike, model: str, width: int, height: int) -> Callable[[np.ndarray], np.ndarray] | None:
    """Function that removes lens distortion from a colour or depth image and keeps k; None where there is no distortion.

    Args:
        model: distortion_model of camera_info: 'plumb_bob', 'rational_polynomial' or 'equidistant'.

    Raises InputError for another model.
    """
    coefficients = np.asarray(d, float)
    if not coefficients.any():
        return None
    matrix, size = np.asarray(k, float).reshape(3, 3), (width, height)
    if model in ("", "plumb_bob", "rational_polynomial"):
        maps = cv2.initUndistortRectifyMap(matrix, coefficients, None, matrix, size, cv2.CV_32FC1)
    elif model == "equidistant":
        maps = cv2.fisheye.initUndistortRectifyMap(matrix, coefficients[:4], np.eye(3), matrix, size, cv2.CV_32FC1)
    else:
        raise InputError(
            f"camera_info has distortion_model {model!r}, must be plumb_bob, rational_polynomial or equidistant; record rectified images"
        )

    def undistort(image: np.ndarray) -> np.ndarray:
        # interpolated depth at a silhouette would lie on neither surface
        how = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_LINEAR
        return cv2.remap(image, *maps, how)

    return undistort


def matrix_from_transform(translation: Sequence[float], rotation: Sequence[float]) -> np.ndarray:
    """Rigid transform (4, 4) [m] of a geometry_msgs/Transform: translation xyz [m], rotation quaternion xyzw.

    Raises InputError where the quaternion has no length or a number is not finite.
    """
    q = np.asarray(rotation, float)
    norm = np.linalg.norm(q)
    if not norm > 1e-6 or not np.isfinite([*q, *translation]).all():
        raise InputError(f"a transform has the rotation {q.tolist()}, must be a unit quaternion xyzw; correct the publisher")
    x, y, z, w = q / norm
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += 2 * (w * axis + axis @ axis)
    matrix[:3, 3] = translation
    return matrix


def pose_in_root(edges: Edges, frame_id: str) -> tuple[np.ndarray, str]:
    """root_from_frame (4, 4) [m] and the root's name: the transforms from `frame_id` up to the end of its chain.

    A frame without a parent is its own root. Raises InputError where the chain is a circle.
    """
    pose, seen = np.eye(4), [frame_id]
    while seen[-1] in edges:
        parent, matrix = edges[seen[-1]]
        if parent in seen:
            raise InputError(f"/tf_static: the transforms {' <- '.join([*seen, parent])} form a circle; correct the publisher")
        pose = matrix @ pose
        seen.append(parent)
    return pose, seen[-1]


def _camera(
    matrix: np.ndarray, width: int, height: int, frame_id: str, world_from_camera: np.ndarray | None, world_frame_id: str
) -> Camera:
    pose = np.eye(4) if world_from_camera is None else np.asarray(world_from_camera, float)
    return Camera(matrix, pose, int(width), int(height), frame_id, world_frame_id or frame_id)
