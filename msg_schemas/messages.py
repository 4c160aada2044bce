"""Builders of plain messages: nested dicts named as in the ROS definitions, without ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..types import Camera

VIEWERS_WORLD = "world"  # the root of the tree where a clip has none
OK, WARN, ERROR = 0, 1, 2  # diagnostic_msgs/msg/DiagnosticStatus


class Message(NamedTuple):
    """A plain message on its way to a topic or a bag."""

    topic: str
    type_name: str  # such as sensor_msgs/msg/PointCloud2
    stamp_ns: int
    fields: dict[str, Any]
    latched: bool


def stamp(nanoseconds: int) -> dict[str, int]:
    """builtin_interfaces/Time."""
    return {"sec": int(nanoseconds // 10**9), "nanosec": int(nanoseconds % 10**9)}


def header(nanoseconds: int, frame_id: str = "") -> dict[str, Any]:
    """std_msgs/Header."""
    return {"stamp": stamp(nanoseconds), "frame_id": frame_id}


def image(head: Mapping[str, Any], pixels: np.ndarray, encoding: str) -> dict[str, Any]:
    """sensor_msgs/Image of an array (H, W) or (H, W, 3), little endian; encoding rgb8, mono8 or 32FC1."""
    pixels = np.ascontiguousarray(pixels)
    return {
        "header": head,
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": pixels.nbytes // max(pixels.shape[0], 1),
        "data": pixels.tobytes(),
    }


def no_image(head: Mapping[str, Any]) -> dict[str, Any]:
    """sensor_msgs/Image without a pixel: says that none will come."""
    return image(head, np.zeros((0, 0), np.uint8), "mono8")


def camera_info(head: Mapping[str, Any], camera: Camera) -> dict[str, Any]:
    """sensor_msgs/CameraInfo without distortion."""
    k = camera.pixel_from_camera.astype(float)
    return {
        "header": head,
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": k.ravel(),
        "r": np.eye(3).ravel(),
        "p": np.hstack([k, np.zeros((3, 1))]).ravel(),
    }


def camera_pose(nanoseconds: int, camera: Camera) -> dict[str, Any]:
    """geometry_msgs/TransformStamped of the camera in its world frame."""
    w, x, y, z = quaternion(camera.world_from_camera[:3, :3])
    tx, ty, tz = map(float, camera.position)
    return {
        "header": header(nanoseconds, world_frame(camera)),
        "child_frame_id": camera.frame_id,
        "transform": {"translation": {"x": tx, "y": ty, "z": tz}, "rotation": {"x": x, "y": y, "z": z, "w": w}},
    }


def static_tree(nanoseconds: int, camera: Camera) -> dict[str, Any]:
    """tf2_msgs/TFMessage that puts the camera's optical frame into the world. A camera without a pose stands in a frame `world` of
    viewers alone, which looks along its x with z up."""
    if camera.pose_known:
        return {"transforms": [camera_pose(nanoseconds, camera)]}
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    return {"transforms": [camera_pose(nanoseconds, replace(camera, world_from_camera=pose, world_frame_id=VIEWERS_WORLD))]}


def gravity(nanoseconds: int, camera: Camera, measured: np.ndarray | None) -> dict[str, Any]:
    """geometry_msgs/Vector3Stamped of a measured gravity [m/s^2] (3,) in the world; zeros without one."""
    x, y, z = (0.0, 0.0, 0.0) if measured is None else map(float, measured)
    return {"header": header(nanoseconds, world_frame(camera)), "vector": {"x": x, "y": y, "z": z}}


def camera_path(stamps: Iterable[int], camera: Camera) -> dict[str, Any]:
    """nav_msgs/Path: where the camera was at every stamp [ns]; the header has the first one."""
    pose = camera_pose(0, camera)["transform"]
    there = {"position": pose["translation"], "orientation": pose["rotation"]}
    poses = [{"header": header(each, world_frame(camera)), "pose": there} for each in stamps]
    return {"header": poses[0]["header"], "poses": poses}


def world_frame(camera: Camera) -> str:
    """Name of the frame in which results are given: root of the camera's transform tree, else the optical frame."""
    return camera.world_frame_id or camera.frame_id


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """Unit quaternion wxyz (w >= 0) of a rotation matrix (3, 3): eigenvector of Bar-Itzhack's symmetric matrix (2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    symmetric = np.array([
        [a - e - i, 0, 0, 0],
        [d + b, e - a - i, 0, 0],
        [g + c, h + f, i - a - e, 0],
        [h - f, c - g, d - b, a + e + i],
    ])  # fmt: skip
    x, y, z, w = np.linalg.eigh(symmetric)[1][:, -1]
    sign = math.copysign(1.0, w)
    return float(sign * w), float(sign * x), float(sign * y), float(sign * z)


def diagnostics(nanoseconds: int, statuses: Iterable[Mapping[str, Any]], frame_id: str = "") -> dict[str, Any]:
    """diagnostic_msgs/DiagnosticArray."""
    return {"header": header(nanoseconds, frame_id), "status": list(statuses)}


def status(name: str, values: Mapping[str, Any], *, level: int = OK, message: str = "", hardware_id: str = "") -> dict[str, Any]:
    """diagnostic_msgs/DiagnosticStatus; values become text, None an empty one."""
    pairs = [{"key": key, "value": _text(value)} for key, value in values.items()]
    return {"level": level, "name": name, "message": message, "hardware_id": hardware_id, "values": pairs}


def values_of(status: Any) -> dict[str, str]:
    """Keys and values of a DiagnosticStatus, plain or rclpy."""
    if isinstance(status, Mapping):
        return {pair["key"]: pair["value"] for pair in status["values"]}
    return {pair.key: pair.value for pair in status.values}


def number(text: str) -> float | None:
    """The finite number that a value of a DiagnosticStatus says; None where it says none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)
