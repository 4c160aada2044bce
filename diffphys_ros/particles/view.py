"""What frame 0 shows of the object, in the body's axes, before its mid-plane is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..types import IGNORE, Camera, Clip
from .edges import coverage
from .frame import Clamp, body_pose, find_clamp, thickness_direction, up_direction
from .silhouette import CELLS_PER_PIXEL, Raster, raster_over

LEAST_PIXELS = 16


@dataclass(frozen=True)
class View:
    """One image of the object and the raster on which its solid is drawn."""

    source: str  # name of the clip, for messages
    camera: Camera
    soft: np.ndarray  # share of each pixel that the object covers, shape (H, W)
    surface: np.ndarray  # depth of the object [m], 0 off it, shape (H, W)
    measured: np.ndarray | None  # depth of everything in view [m], 0 where unknown, shape (H, W); None without a depth topic
    pose: np.ndarray  # world_from_body with z = 0 through the clamp's centre, shape (4, 4)
    raster: Raster
    front: float  # height of the front face [m]
    footprint_m: float  # side of a pixel on the object
    clamp: Clamp | None

    def front_pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (nx, ny, 2) and depths (nx, ny) [m] of the raster's cells on the front face."""
        cells = np.concatenate([self.raster.centres, np.full((*self.raster.shape, 1), self.front)], -1)
        return self.camera.project(cells @ self.pose[:3, :3].T + self.pose[:3, 3])


def object_mask(labels: np.ndarray, depth0: np.ndarray) -> np.ndarray:
    """Pixels of the object with a depth, bool (H, W)."""
    return (labels > 0) & (labels != IGNORE) & (depth0 > 0)


def view_of(clip: Clip, depth0: np.ndarray, mask: np.ndarray, scene: Scene) -> View:
    """The view of frame 0. Raises InputError where the mask is too small or the clamp does not fit."""
    v, u = np.nonzero(mask)
    if len(v) < LEAST_PIXELS:
        raise InputError(
            f"{clip.source or 'clip'}: the object covers {len(v)} pixels with depth in frame 0, needs at least {LEAST_PIXELS}; give a larger scene.first_mask"
        )
    points = clip.camera.backproject(np.stack([u, v], -1).astype(float), depth0[v, u].astype(float))
    towards = thickness_direction(scene, clip.camera, points)
    clamp = find_clamp(scene, points, towards)
    pose = body_pose(clamp, points, towards, up_direction(scene, clip.camera))
    footprint = float(np.median(depth0[v, u])) / clip.camera.focal_px
    seen = (points - pose[:3, 3]) @ pose[:3, :3]
    return View(
        source=clip.source or "clip",
        camera=clip.camera,
        soft=coverage(clip.frames[0], mask),
        surface=np.where(mask, depth0, 0.0).astype(float),
        measured=None if clip.depth is None else clip.depth[0],
        pose=pose,
        raster=raster_over(seen, footprint / CELLS_PER_PIXEL, from_zero=clamp is not None),
        front=front_level(seen[:, 2], footprint),
        footprint_m=footprint,
        clamp=clamp,
    )


def front_level(height: np.ndarray, footprint_m: float) -> float:
    """Height of the front face [m]: the median of the points near the top, so that specks in front do not count."""
    top = float(np.quantile(height, 0.985))
    return float(np.median(height[height > top - 3 * footprint_m]))
