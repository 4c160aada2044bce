"""A still room by ray tracing: a textured box above a textured floor before a textured wall, seen by cameras that are known."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from diffphys_ros.bags.write import write_recording
from diffphys_ros.types import Camera
from tests.boxes import camera_at

LOW, HIGH = np.array([-0.10, -0.03, 0.0]), np.array([0.10, 0.03, 0.08])  # of the box [m]
FLOOR_Z, WALL_Y = -0.06, 0.45  # m
SIZE = (320, 240)  # px
FOCAL = 330.0  # px
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 33_333_333
CENTRE = np.array([0.0, 0.0, 0.03])


def camera_from(azimuth_deg: float, elevation_deg: float, distance: float = 0.5, *, focal: float = FOCAL, size: tuple[int, int] = SIZE) -> Camera:
    """A camera that looks at the box; azimuth 0 is the front (world -y)."""
    a, e = np.radians((azimuth_deg, elevation_deg))
    position = CENTRE + distance * np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    return camera_at(tuple(position), tuple(CENTRE), width=size[0], height=size[1], focal=focal)


def around(count: int, span_deg: float) -> list[Camera]:
    """Cameras on an arc about the front, at changing heights and distances."""
    at = np.linspace(-span_deg / 2, span_deg / 2, count)
    return [camera_from(a, (12, 28, 20)[k % 3], 0.5 + 0.04 * (k % 4)) for k, a in enumerate(at)]


def trace(camera: Camera, pixels: np.ndarray, *, texture: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour (..., 3) 0..255, depth (...) [m] and whether it is the box (...) at pixels (..., 2)."""
    rays = camera.rays(pixels)
    floor = (FLOOR_Z - camera.position[2]) / np.minimum(rays[..., 2], -1e-9)
    wall = (WALL_Y - camera.position[1]) / np.where(np.abs(rays[..., 1]) < 1e-9, 1e-9, rays[..., 1])
    safe = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    a, b = (LOW - camera.position) / safe, (HIGH - camera.position) / safe
    first, last = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    box = np.where((first < last) & (first > 0), first, np.inf)
    depth = np.minimum(np.minimum(np.where(floor > 0, floor, np.inf), np.where(wall > 0, wall, np.inf)), box)
    depth = np.where(np.isfinite(depth), depth, 3.0)
    colour = pattern(camera.position + rays * depth[..., None]) if texture else np.full(rays.shape, 120.0)
    return colour, depth, box <= depth


def pattern(points: np.ndarray) -> np.ndarray:
    """Colour (..., 3) of the matter at points (..., 3) [m]: blotches from 3 mm to 3 cm."""
    total = np.zeros((*points.shape[:-1], 3))
    for k, (pitch, share) in enumerate(((0.004, 0.35), (0.009, 0.4), (0.03, 0.25))):
        for c in range(3):
            at = np.moveaxis(points / pitch, -1, 0) % 63
            total[..., c] += share * map_coordinates(_noise(3 * k + c), at, order=1, mode="wrap")
    return np.clip(255 * (0.5 + 1.6 * (total - 0.5)), 0, 255)


@cache
def _noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(size=(64, 64, 64))


def picture(camera: Camera, *, texture: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image uint8 (H, W, 3) with softened edges, depth (H, W) [m], mask of the box (H, W)."""
    grid = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(float)
    shifts = [np.array(s) for s in ((-0.25, -0.25), (0.25, 0.25))]
    colour = np.mean([trace(camera, grid + s, texture=texture)[0] for s in shifts], 0)
    _, depth, mask = trace(camera, grid, texture=False)
    return np.round(colour).astype(np.uint8), depth, mask


def write_pictures(folder: Path, cameras: list[Camera], *, texture: bool = True) -> Path:
    """A folder of pictures view_00.png, view_01.png, ..."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, camera in enumerate(cameras):
        cv2.imwrite(str(folder / f"view_{k:02d}.png"), picture(camera, texture=texture)[0][..., ::-1])
    return folder


def write_clip(path: Path, camera: Camera, *, depth: bool = True, frames: int = 2, mirrored: bool = False) -> Path:
    """A recording in which nothing moves: colour, camera_info, the camera's pose, the box as its mask, depth in whole millimetres."""
    image, true, mask = (array[:, ::-1] if mirrored else array for array in picture(camera))
    messages: list[tuple[str, str, int, dict[str, object], bool]] = []
    for k in range(frames):
        ns = START_NS + k * PERIOD_NS
        messages.append(("/image", "sensor_msgs/msg/Image", ns, _image(ns, image, "rgb8"), False))
        messages.append(("/mask", "sensor_msgs/msg/Image", ns, _image(ns, np.where(mask, 1, 0).astype(np.uint8), "mono8"), False))
        if depth:
            messages.append(("/depth", "sensor_msgs/msg/Image", ns, _image(ns, np.round(1000 * true).astype(np.uint16), "16UC1"), False))
    info = {"header": _header(START_NS), "height": camera.height, "width": camera.width, "distortion_model": "plumb_bob", "d": np.zeros(5)}
    messages.append(("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, info | {"k": camera.pixel_from_camera.ravel().tolist()}, False))
    x, y, z, w = Rotation.from_matrix(camera.world_from_camera[:3, :3]).as_quat()
    transform = {"translation": dict(zip("xyz", camera.position.tolist(), strict=True)), "rotation": {"x": x, "y": y, "z": z, "w": w}}
    link = {"header": _header(START_NS) | {"frame_id": "world"}, "child_frame_id": "camera_optical", "transform": transform}
    messages.append(("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, {"transforms": [link]}, True))
    return write_recording(path, messages)


def _header(ns: int) -> dict[str, object]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "camera_optical"}


def _image(ns: int, data: np.ndarray, encoding: str) -> dict[str, object]:
    shape = {"height": data.shape[0], "width": data.shape[1], "step": data.nbytes // data.shape[0]}
    return {"header": _header(ns), "encoding": encoding, "data": data.tobytes()} | shape
