"""Cameras from camera_info or a field of view, undistortion, and transforms as matrices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import ArrayLike

from diffphys_ros.errors import InputError, listed, named
from diffphys_ros.types import Camera

ASSUMED_FOV_DEG = 50.0
FOV_DEG = (0.1, 175.0)  # fields of view that a camera_info may state, horizontally and vertically
MOST_OFFSET = 10.0  # of the principal point from the image's corner, in sizes of the image: a crop lies beside it
ROTATION = 1e-3  # by which products of the rows of a rotation may be off
SKEW = 1e-6  # of the focal length, up to which a skew is rounding
EQUIDISTANT = "equidistant"
COEFFICIENTS = {"plumb_bob": (4, 5), "rational_polynomial": (4, 5, 8, 12, 14), EQUIDISTANT: (4,)}  # numbers that a model may have
LEAST_INSIDE = 0.5  # of the undistorted picture that must come from inside of the distorted one
MOST_SIDE = 32766  # px: OpenCV counts the pixels of a map in 16 bits
MOST_DISTANCE_M = 1e6  # of a camera from its world's origin; beyond, double precision no longer tells what a clip shows


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

    Raises InputError where k is no such matrix: focal lengths that are no camera's, a skew, a scale, a number that is not finite.
    """
    return _camera(_intrinsics(k, d, width, height), width, height, frame_id, world_from_camera, world_frame_id)


def _intrinsics(k: ArrayLike, d: ArrayLike, width: int, height: int) -> np.ndarray:
    """The intrinsic matrix (3, 3) [px] of a pinhole camera without skew."""
    numbers = np.asarray(k, float).ravel()
    if numbers.size != 9:
        raise InputError(f"camera_info has a K of {numbers.size} numbers, must have 9; calibrate the camera")
    matrix = numbers.reshape(3, 3)
    if not np.isfinite(matrix).all() or not np.isfinite(np.asarray(d, float)).all():
        raise InputError("camera_info holds numbers that are not finite; calibrate the camera")
    for i, size, name in ((0, width, "width"), (1, height, "height")):
        focal, middle = matrix[i, i], matrix[i, 2]
        if focal <= 0:
            raise InputError(f"camera_info has focal length K[{4 * i}] = {focal:g}, must be above 0; calibrate the camera or set camera.fov_deg")
        narrowest, widest = (size / 2 / math.tan(math.radians(fov) / 2) for fov in FOV_DEG)
        if size and not widest <= focal <= narrowest:
            raise InputError(
                f"camera_info has focal length K[{4 * i}] = {focal:g} px at a {name} of {size} px, must be between {widest:.3g} and {narrowest:.3g} "
                f"({FOV_DEG[1]:g} to {FOV_DEG[0]:g} degrees); calibrate the camera"
            )
        if size and abs(middle) > MOST_OFFSET * size:
            raise InputError(
                f"camera_info has its optical axis at K[{3 * i + 2}] = {middle:g} px at a {name} of {size} px, must be within "
                f"{MOST_OFFSET * size:g} px; calibrate the camera"
            )
    if abs(matrix[0, 1]) > SKEW * matrix[0, 0] or matrix[1, 0] or matrix[2, 0] or matrix[2, 1] or matrix[2, 2] != 1:
        raise InputError(
            f"camera_info has K[1, 3, 6, 7, 8] = {', '.join(f'{numbers[j]:g}' for j in (1, 3, 6, 7, 8))}, must be 0, 0, 0, 0, 1 (a camera without skew, "
            "in pixels); calibrate the camera"
        )
    matrix = matrix.copy()
    matrix[0, 1] = 0.0
    return matrix


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


def undistorter(
    k: ArrayLike, d: ArrayLike, model: str, width: int, height: int, *, turn: np.ndarray | None = None
) -> Callable[[np.ndarray], np.ndarray] | None:
    """Function that removes lens distortion from a colour or depth image and keeps k; None where there is none to remove.

    Args:
        model: distortion_model of camera_info: 'plumb_bob', 'rational_polynomial' or 'equidistant'. The last bends rays with
            coefficients of 0 too.
        turn: rotation (3, 3) from the camera as it stands to the one that is wanted, R of camera_info.

    Raises InputError for another model, a number of coefficients that the model does not have, and a distortion that no lens has.
    """
    coefficients = np.asarray(d, float).ravel()
    straight = not coefficients.any() and not (model == EQUIDISTANT and coefficients.size)
    if straight and turn is None:
        return None
    matrix, size = _intrinsics(k, d, width, height), (width, height)
    allowed = COEFFICIENTS.get(model or "rational_polynomial")
    if straight:
        model, coefficients = "plumb_bob", np.zeros(5)
    elif allowed is None:
        raise InputError(
            f"camera_info has distortion_model '{named(model)}', must be plumb_bob, rational_polynomial or equidistant; record rectified images"
        )
    elif coefficients.size not in allowed:
        raise InputError(
            f"camera_info has {coefficients.size} distortion coefficients for {model or 'no distortion_model'}, must be {listed(allowed)}; "
            "calibrate the camera, or record rectified images"
        )
    if max(size) > MOST_SIDE:
        raise InputError(f"camera_info has a distortion for images of {width}x{height} px, at most {MOST_SIDE} px a side can be undistorted; record smaller images")
    turn = np.eye(3) if turn is None else _rotation(turn)
    if model == EQUIDISTANT:
        maps = cv2.fisheye.initUndistortRectifyMap(matrix, coefficients, turn, matrix, size, cv2.CV_32FC1)
    else:
        maps = cv2.initUndistortRectifyMap(matrix, coefficients, turn, matrix, size, cv2.CV_32FC1)
    inside = (maps[0] >= 0) & (maps[0] <= width - 1) & (maps[1] >= 0) & (maps[1] <= height - 1)  # false for NaN
    if inside.mean() < LEAST_INSIDE:
        raise InputError(
            f"camera_info has a distortion that puts {1 - inside.mean():.0%} of the undistorted picture outside of the recorded one, at most "
            f"{1 - LEAST_INSIDE:.0%} may be; calibrate the camera, or record rectified images"
        )

    def undistort(image: np.ndarray) -> np.ndarray:
        # interpolated depth at a silhouette would lie on neither surface
        how = cv2.INTER_NEAREST if image.ndim == 2 else cv2.INTER_LINEAR
        return cv2.remap(image, *maps, how)

    return undistort


def _rotation(turn: np.ndarray) -> np.ndarray:
    bounded = np.abs(turn).max() < 1 + ROTATION  # false for NaN
    if not bounded or np.abs(turn @ turn.T - np.eye(3)).max() > ROTATION or np.linalg.det(turn) < 0:
        raise InputError("camera_info has an R that is no rotation; calibrate the camera, or record rectified images")
    return turn


def matrix_from_transform(translation: Sequence[float], rotation: Sequence[float]) -> np.ndarray:
    """Rigid transform (4, 4) [m] of a geometry_msgs/Transform: translation xyz [m], rotation quaternion xyzw.

    Raises InputError where the quaternion has no length, or a number is not finite or absurd.
    """
    q = np.asarray(rotation, float)
    bounded = np.abs([*q, *translation]).max() < MOST_DISTANCE_M  # false for NaN
    norm = np.linalg.norm(q) if bounded else 0.0
    if not norm > 1e-6:
        raise InputError(
            f"a transform has the rotation {named(q.tolist())} and the translation {named(list(translation))}, must be a unit quaternion xyzw and a place within {MOST_DISTANCE_M:g} m; "
            "correct the publisher"
        )
    x, y, z, w = q / norm
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += 2 * (w * axis + axis @ axis)
    matrix[:3, 3] = translation
    return matrix


def _camera(
    matrix: np.ndarray, width: int, height: int, frame_id: str, world_from_camera: np.ndarray | None, world_frame_id: str
) -> Camera:
    pose = np.eye(4) if world_from_camera is None else np.asarray(world_from_camera, float)
    return Camera(matrix, pose, int(width), int(height), frame_id, world_frame_id or frame_id)
