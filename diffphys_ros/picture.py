"""What a person says in the picture of frame 0 (`scene.*_px`), and where that lies in the world.

A pixel says a direction. The plane on which it lies is the object's: its front for the clamp, its middle for the floor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .config import Scene
from .config.values import LINES
from .errors import InputError
from .types import Camera, Clip

STANDARD_GRAVITY = 9.80665  # m/s^2
AT_BORDER_PX = 3.0  # from the picture's border within which a clamp's line says that the clamp lies beyond it [chosen]


def told_in_picture(clip: Clip, scene: Scene) -> Clip:
    """The clip with gravity where `scene.down_px` points, else as it is.

    Raises InputError for points outside of the picture, a length without its metres and a rest frame that the clip has not got.
    """
    width, height = clip.camera.width, clip.camera.height
    for name in LINES:
        line = getattr(scene, name)
        if line is not None and not all(0 <= u <= width and 0 <= v <= height for u, v in np.reshape(line, (2, 2))):
            raise InputError(f"{clip.source or 'clip'}: scene.{name} {line} lies outside of the picture, u must be in 0 .. {width} and v in 0 .. {height}; correct its points")
    if scene.length_px is not None and scene.size_m is None:
        raise InputError(f"{clip.source or 'clip'}: scene.length_px marks a length that nobody tells; give it in metres as scene.size_m")
    if scene.rest_frame is not None and scene.rest_frame >= len(clip):
        raise InputError(f"{clip.source or 'clip'}: scene.rest_frame is {scene.rest_frame}, must be one of the clip's frames 0 .. {len(clip) - 1}; correct it")
    if scene.down_px is None:
        return clip
    down = np.array([*scene.down_px, 0.0])
    return replace(clip, gravity=STANDARD_GRAVITY * clip.camera.world_from_camera[:3, :3] @ (down / np.linalg.norm(down)))


def extent_px(mask: np.ndarray) -> float:
    """Diagonal [px] of the smallest upright box about a mask (H, W) that is not empty."""
    return float(np.linalg.norm([np.ptp(np.flatnonzero(mask.any(axis))) + 1.0 for axis in (0, 1)]))


def length_at_unit_depth(camera: Camera, line_px: list[float]) -> float:
    """Distance of the two points u v u v [px] of a line on the plane at unit depth."""
    ends = camera.rays(np.reshape(line_px, (2, 2)).astype(float))
    return float(np.linalg.norm(ends[1] - ends[0]))


def on_plane(camera: Camera, pixels: np.ndarray, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """World points (..., 3) [m] at which the rays through pixels (..., 2) meet the plane through `point` across `normal`, (3,) each."""
    rays = camera.rays(pixels)
    return camera.position + rays * (((point - camera.position) @ normal) / (rays @ normal))[..., None]


def along_border(line_px: list[float], shape: tuple[int, int]) -> bool:
    """Whether a line u v u v [px] runs along the border of a picture (H, W)."""
    line, last = np.reshape(line_px, (2, 2)), np.array(shape[::-1]) - 1.0
    return bool(((line <= AT_BORDER_PX).all(0) | (line >= last - AT_BORDER_PX).all(0)).any())


def side_of(line_px: list[float], pixels: np.ndarray) -> np.ndarray:
    """Distance (...) [px] of pixels (..., 2) from the straight line through two points u v u v, positive on one side of it."""
    begin, end = np.reshape(line_px, (2, 2)).astype(float)
    along = (end - begin) / np.linalg.norm(end - begin)
    return (pixels - begin) @ np.array([-along[1], along[0]])
