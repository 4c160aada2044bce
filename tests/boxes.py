"""Exactly rendered boxes for the tests of the front end: rays against a moving textured box, a mount and a wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from diffphys_ros.config import Settings, build
from diffphys_ros.types import Camera, Clip

PART_COLOURS = np.array([[200, 60, 50], [50, 150, 60], [60, 70, 200]], float)
MOUNT_COLOUR, WALL_COLOUR = np.array([90.0, 90, 95]), np.array([150.0, 150, 140])
WALL_Y = 0.6  # m, behind the box
SUPERSAMPLING = 3


@dataclass(frozen=True)
class Box:
    """A textured box from `low` to `high` [m] in its own frame; parts change at `cuts` along x."""

    low: np.ndarray
    high: np.ndarray
    cuts: tuple[float, ...] = ()

    @property
    def volume(self) -> float:
        return float(np.prod(self.high - self.low))


def bar(*, cuts: tuple[float, ...] = ()) -> Box:
    """0.24 x 0.05 x 0.06 m, clamped at x = 0; y is the direction that the camera looks along."""
    return Box(np.array([0.0, -0.025, -0.03]), np.array([0.24, 0.025, 0.03]), cuts)


def camera_at(position: tuple[float, float, float], target: tuple[float, float, float], *, width: int = 240, height: int = 160, focal: float = 300.0) -> Camera:
    """A camera in the world (z up) that looks at a point."""
    forward = np.subtract(target, position) / np.linalg.norm(np.subtract(target, position))
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], -1)
    pose[:3, 3] = position
    return Camera(np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]), pose, width, height, "camera_optical", "world")


def oblique_camera() -> Camera:
    """Sees the bar's front, its top and its free end."""
    return camera_at((0.2, -0.45, 0.14), (0.12, 0, 0))


def turned(angle: float, axis: int = 1) -> np.ndarray:
    """World_from_box (4, 4) of a box turned by an angle [rad] about a world axis through the origin."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    pose = np.eye(4)
    pose[i, i] = pose[j, j] = np.cos(angle)
    pose[j, i], pose[i, j] = np.sin(angle), -np.sin(angle)
    return pose


def box_clip(box: Box, poses: list[np.ndarray], camera: Camera, *, mount: Box | None = None, depth: bool = True) -> Clip:
    """A clip of a box in these poses; labels are the true part labels of every frame, depth is in whole millimetres."""
    views = [_view(box, pose, camera, mount) for pose in poses]
    frames, labels, depths = (np.stack([view[i] for view in views]) for i in range(3))
    clip = Clip(frames.astype(np.uint8), 1_000_000_000, 1 / 30, camera, labels=labels.astype(np.uint8), source="made-up box")
    return replace(clip, depth=(np.round(depths * 1000) / 1000).astype(np.float32)) if depth else clip


def limbs_clip(limbs: list[Box], camera: Camera) -> Clip:
    """A clip of one frame of boxes that are one object of one part, with its depth."""
    clips = [box_clip(limb, [np.eye(4)], camera) for limb in limbs]
    depth = np.stack([clip.depth for clip in clips])
    frames = np.take_along_axis(np.stack([clip.frames for clip in clips]), depth.argmin(0)[None, ..., None], 0)[0]
    labels = np.any([clip.labels > 0 for clip in clips], 0).astype(np.uint8)
    return replace(clips[0], frames=frames, labels=labels, depth=depth.min(0))


def bar_settings(**values: object) -> Settings:
    """What a person would say about `bar()`; further dotted settings with '__' for the dot."""
    known = {"scene.mass_kg": 0.36, "scene.thickness_m": 0.05, "scene.thickness_axis": [0.0, 1.0, 0.0], "scene.clamp_box_m": [-0.005, -0.03, -0.035, 0.005, 0.03, 0.035]}
    return build(known | {name.replace("__", "."): value for name, value in values.items()})


def _view(box: Box, pose: np.ndarray, camera: Camera, mount: Box | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    steps = (np.arange(SUPERSAMPLING) + 0.5) / SUPERSAMPLING - 0.5
    offsets = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(float)
    colour = np.mean([_trace(box, pose, camera, mount, pixels + offset)[0] for offset in offsets], 0)
    _, label, depth = _trace(box, pose, camera, mount, pixels)
    return np.clip(np.round(colour), 0, 255), label, depth


def _trace(box: Box, pose: np.ndarray, camera: Camera, mount: Box | None, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rays = camera.rays(pixels)
    depth = (WALL_Y - camera.position[1]) / rays[..., 1]
    depth = np.where(depth > 0, depth, 10.0)
    colour = np.broadcast_to(WALL_COLOUR, rays.shape).copy()
    label = np.zeros(rays.shape[:2], int)
    if mount is not None:
        hit = _enter(mount, camera.position, rays)
        nearer = hit < depth
        depth, colour[nearer] = np.where(nearer, hit, depth), MOUNT_COLOUR
    start, direction = pose[:3, :3].T @ (camera.position - pose[:3, 3]), rays @ pose[:3, :3]
    hit = _enter(box, start, direction)
    nearer = hit < depth
    where = start + direction[nearer] * hit[nearer][:, None]
    part = np.searchsorted(box.cuts, where[:, 0])
    colour[nearer] = PART_COLOURS[part] * (0.75 + 0.35 * texture(where))[:, None]
    label[nearer] = part + 1
    return colour, label, np.where(nearer, hit, depth)


def texture(points: np.ndarray) -> np.ndarray:
    """A smooth pattern in -1..1 fixed to the material, of features a few millimetres wide (P,)."""
    waves = np.random.default_rng(7).normal(size=(24, 3)) * 350
    phase = np.random.default_rng(8).uniform(0, 2 * np.pi, 24)
    angle = (points @ waves.T + phase).astype(np.float32)  # whose sines cost a quarter
    return np.clip(np.sin(angle).sum(-1) / 5, -1, 1)


def _enter(box: Box, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Depth at which rays (..., 3) enter a box; infinite where they miss it."""
    first, last = np.full(direction.shape[:-1], -np.inf), np.full(direction.shape[:-1], np.inf)
    for axis in range(3):  # a reduction over an axis of three is slow
        along = np.ascontiguousarray(direction[..., axis])
        safe = np.where(np.abs(along) < 1e-12, 1e-12, along)
        a, b = (box.low[axis] - start[axis]) / safe, (box.high[axis] - start[axis]) / safe
        first, last = np.maximum(first, np.minimum(a, b)), np.minimum(last, np.maximum(a, b))
    return np.where((first < last) & (first > 0), first, np.inf)
