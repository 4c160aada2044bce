"""Surface depth without a depth topic: a slab whose front lies where what is known of the scene puts it."""

from __future__ import annotations

import numpy as np

from ..config import Settings
from ..types import Camera, Clip
from .plane import flat_depth
from .scale import CLAMP, DepthSource, on_clamp

LAYERS = 32  # steps through the thickness in the search for a side face


def inflated_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels on a slab of the scene's thickness, and where its front plane comes from.

    Metric where clamp box, thickness axis and the camera's pose are known: the front lies across the axis, half a thickness before
    the box's centre. Otherwise it lies across the optical axis, where the known size puts it or one metre away: everything metric is
    then assumed. Pixels whose ray
    meets the front beside the silhouette see a side face, and get the depth at which the ray enters the slab.
    """
    scene, camera = settings.scene, clip.camera
    if not on_clamp(clip, settings):
        return flat_depth(clip, mask, settings)
    assert scene.clamp_box_m is not None
    assert scene.thickness_unit is not None
    centre = np.reshape(scene.clamp_box_m, (2, 3)).mean(0)
    axis = np.array(scene.thickness_unit)
    normal = axis * np.sign((camera.position - centre) @ axis)
    thickness = scene.thickness_m or 0.0
    v, u = np.nonzero(mask)
    rays = camera.rays(np.stack([u, v], -1).astype(float))
    depth = np.zeros(mask.shape, np.float32)
    depth[v, u] = _entry(camera, rays, mask, centre + normal * thickness / 2, normal, thickness)
    return depth, DepthSource("inflated from the silhouette on the clamp's plane", CLAMP)


def _entry(camera: Camera, rays: np.ndarray, mask: np.ndarray, front: np.ndarray, normal: np.ndarray, thickness: float) -> np.ndarray:
    """Depth [m] (P,) at which rays (P, 3) enter the slab between the plane through `front` across `normal` and that a thickness behind.

    A point between the planes is inside where its column, continued to either plane, falls into the mask.
    """
    slope = rays @ normal
    towards = np.where(slope < -1e-3, slope, np.nan)
    nearest = ((front - camera.position) @ normal) / towards
    entry = np.full(len(rays), np.nan)
    for layer in np.linspace(0, thickness, LAYERS + 1 if thickness else 1):
        depth = nearest - layer / towards
        column = camera.position + rays * depth[:, None] + normal * layer
        inside = _falls_in(camera, column, mask) & _falls_in(camera, column - normal * thickness, mask)
        entry = np.where(np.isnan(entry) & inside, depth, entry)
    depth = np.where(np.isnan(entry), nearest, entry)
    return np.where(depth > 0, depth, 0.0)


def _falls_in(camera: Camera, points: np.ndarray, mask: np.ndarray) -> np.ndarray:
    pixels = camera.project(np.nan_to_num(points, nan=np.inf))[0] if len(points) else np.zeros((0, 2))
    index = np.rint(np.nan_to_num(pixels, nan=-1.0, posinf=-1.0, neginf=-1.0)).astype(int)
    seen = np.all((index >= 0) & (index < (mask.shape[1], mask.shape[0])), axis=-1)
    index = np.where(seen[:, None], index, 0)
    return seen & mask[index[:, 1], index[:, 0]]
