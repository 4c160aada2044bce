"""What frame 0 shows of the object, in the body's axes, before its mid-plane is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from ..config import Scene
from ..errors import InputError
from ..inpaint import nearest_known
from ..types import Camera, Clip, object_mask
from .edges import coverage
from .end_face import lean_of_end
from .frame import Clamp, body_pose, find_clamp, leaning, thickness_direction, up_direction
from .silhouette import CELLS_PER_PIXEL, Raster, projected, raster_over

LEAST_PIXELS = 16
SMOOTH_PX = 7  # over which a surface is taken to be straight; depth is averaged over as many pixels, so that noise has no memory of it
SPECK_PX = 5  # side of the window over whose median specks do not rise
TOP = 0.995  # quantile of the front's heights that is taken for the highest
FRONT_PX = 2.0  # footprints of a pixel below the front's level that still belong to it
STEP_PX = 0.5  # footprints of a pixel by which a front that tapers may rise at its clamp beyond what its taper says [chosen]
TOP_NOISE = 5.0  # standard deviations below it that are still the same level


@dataclass(frozen=True)
class FrontView:
    """One image of the object and the raster on which its solid is drawn."""

    source: str  # name of the clip, for messages
    camera: Camera
    soft: np.ndarray  # share of each pixel that the object covers, shape (H, W)
    surface: np.ndarray  # depth of the object [m], 0 off it, shape (H, W)
    measured: np.ndarray | None  # depth of everything in view [m], 0 where unknown, shape (H, W); None without a depth topic
    pose: np.ndarray  # world_from_body with z = 0 through the clamp's centre, shape (4, 4)
    raster: Raster
    front: float  # height of the front face where the body is thickest [m]
    noise_m: float  # standard deviation of the surface's height
    footprint_m: float  # side of a pixel on the object
    clamp: Clamp | None
    lean: float = 0.0  # of the clamped plane off its box face, about z [rad]
    behind_m: float = 0.0  # how far the clamped plane lies behind the line that was drawn for it

    def pixels_at(self, height: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (nx, ny, 2) and depths (nx, ny) [m] of the raster's cells at a height (nx, ny) or one for all [m]."""
        return projected(self.raster, self.pose, self.camera, height)

    def front_pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """The same on the front face."""
        return self.pixels_at(self.front)


def mask_with_depth(labels: np.ndarray, depth0: np.ndarray) -> np.ndarray:
    """Pixels of the object with a depth, bool (H, W)."""
    return object_mask(labels) & (depth0 > 0)


def view_of(clip: Clip, depth0: np.ndarray, mask: np.ndarray, scene: Scene, behind_px: float = 0.0, soft: np.ndarray | None = None) -> FrontView:
    """The view of frame 0; a clamp that was drawn as a line lies so far behind it. `soft` (H, W) is the share of
    each pixel that the object covers, where that is known better than from frame 0. Raises InputError where the mask is too small or the clamp does not fit."""
    v, u = np.nonzero(mask)
    if len(v) < LEAST_PIXELS:
        raise InputError(
            f"{clip.source or 'clip'}: the object covers {len(v)} pixels with depth in frame 0, needs at least {LEAST_PIXELS}; give a larger scene.first_mask"
        )
    points = clip.camera.backproject(np.stack([u, v], -1).astype(float), depth0[v, u].astype(float))
    towards = thickness_direction(scene, clip.camera, points)
    clamp = find_clamp(scene, clip.camera, points, towards, behind_px)
    pose = body_pose(clamp, points, towards, up_direction(scene, clip.camera))
    footprint = float(np.median(depth0[v, u])) / clip.camera.focal_px
    seen = (points - pose[:3, 3]) @ pose[:3, :3]
    height = np.zeros(mask.shape)
    height[v, u] = seen[:, 2]
    noise = height_noise(height, mask)
    told = _measured(mask, clip)
    front = _front_of(clamp, seen[told[mask]], height, told, noise, footprint)
    lean = 0.0
    if clamp is not None and not clamp.drawn:
        below = max(FRONT_PX * footprint, TOP_NOISE * noise)
        lean = lean_of_end(on_front(seen, (clip.camera.position - pose[:3, 3]) @ pose[:3, :3], front, below), footprint, float(np.abs(pose[:3, 1]) @ clamp.half_size))
        pose = leaning(pose, lean) if lean else pose
        seen = (points - pose[:3, 3]) @ pose[:3, :3]
    return FrontView(
        source=clip.source or "clip",
        camera=clip.camera,
        soft=coverage(clip.frames[0], mask) if soft is None else soft,
        surface=np.where(mask, depth0, 0.0).astype(float),
        measured=None if clip.depth is None else clip.depth[0],
        pose=pose,
        raster=raster_over(seen, footprint / CELLS_PER_PIXEL, from_zero=clamp is not None, beside_m=behind_px * footprint),
        front=front,
        noise_m=noise,
        footprint_m=footprint,
        clamp=clamp,
        lean=lean,
        behind_m=behind_px * footprint,
    )


def _measured(mask: np.ndarray, clip: Clip) -> np.ndarray:
    """The pixels of a mask (H, W) whose depth was measured, as far as there are some: what is filled in may stand out from the front."""
    there = mask if clip.depth is None else mask & (clip.depth[0] > 0)
    return there if there.sum() >= LEAST_PIXELS else mask


def _front_of(clamp: Clamp | None, seen: np.ndarray, height: np.ndarray, mask: np.ndarray, noise_m: float, footprint_m: float) -> float:
    """Height of the front where it is highest [m], of a height (H, W) on a mask whose points in the body's frame are `seen` (P, 3). What rises at the box that
    holds the body by more than the front does beyond it is the edge of a mount, nearer to the camera, that the mask takes in."""
    level = front_level(height, mask, noise_m)
    if clamp is None or clamp.drawn:
        return level
    edge = clamp.reach_m + SMOOTH_PX * footprint_m
    beyond, near, far = (_pixels(mask, (seen[:, 0] > k * edge) & (seen[:, 0] <= end * edge)) for k, end in ((1, np.inf), (1, 2), (2, 3)))
    if min(part.sum() for part in (beyond, near, far)) < LEAST_PIXELS:
        return level
    free, nearer, farther = (front_level(height, part, noise_m) for part in (beyond, near, far))
    at_clamp = max(free, nearer + 1.5 * (nearer - farther))  # from the middles of the two, on to the clamped plane
    return level if level <= at_clamp + max(STEP_PX * footprint_m, TOP_NOISE * noise_m) else free


def _pixels(mask: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The pixels (H, W) of a mask that are `chosen` (P,) among them."""
    part = np.zeros_like(mask)
    part[mask] = chosen
    return part


def on_front(seen: np.ndarray, eye: np.ndarray, front: float, below: float) -> np.ndarray:
    """x and y (Q, 2) at which the rays from `eye` (3,) through points (P, 3) in the body's frame [m] meet the front's plane, of points at most
    `below` under it: the outline as sharp as the picture shows it, whatever the depth's noise."""
    kept = seen[seen[:, 2] > front - below]
    share = (front - eye[2]) / (kept[:, 2] - eye[2])
    return eye[:2] + share[:, None] * (kept[:, :2] - eye[:2])


def height_noise(height: np.ndarray, mask: np.ndarray) -> float:
    """Standard deviation of a smooth surface's height (H, W) [m] on the mask: what bends within SMOOTH_PX in one direction of the image or
    the other, whichever bends less."""
    found = []
    for h, known in ((height, mask), (height.T, mask.T)):
        near, middle, far = (slice(i * SMOOTH_PX, len(h) - (2 - i) * SMOOTH_PX) for i in range(3))
        bent = (h[near] - 2 * h[middle] + h[far])[known[near] & known[middle] & known[far]]
        found += [1.4826 * float(np.median(np.abs(bent))) / np.sqrt(6)] if len(bent) else []
    return min(found, default=0.0)


def front_level(height: np.ndarray, mask: np.ndarray, noise_m: float) -> float:
    """Height of the front where it is highest [m]: that of its top as far as noise spreads it; specks in front do not count."""
    clean = median_filter(nearest_known(height, mask), SPECK_PX, mode="nearest")[mask]
    return float(np.median(clean[clean >= np.quantile(clean, TOP) - TOP_NOISE * noise_m]))
