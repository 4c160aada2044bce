"""Surface depth without a depth topic: a slab whose front lies where what is known of the scene puts it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..columns import solid_columns
from ..config import Settings
from ..inpaint import nearest
from ..types import Camera, Clip
from .plane import flat_depth
from .scale import CLAMP, DepthSource, on_clamp

LAYERS = 32  # steps through the thickness in the search for a side face


def inflated_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels on a slab of the scene's thickness, and where its front plane comes from.

    Metric where clamp box, thickness axis and the camera's pose are known: the front lies across the axis, half a thickness before
    the box's centre. Otherwise it lies across the optical axis, where the known size puts it or one metre away: everything metric is
    then assumed. Pixels whose ray meets the front beside what is solid see a side face, and get the depth at which the ray enters the slab.
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
    slab = _Slab(camera, centre + normal * thickness / 2, normal, thickness)
    depth = np.zeros(mask.shape, np.float32)
    depth[v, u] = slab.entry(np.stack([u, v], -1).astype(float), slab.solid(mask))
    return depth, DepthSource("inflated from the silhouette on the clamp's plane", CLAMP)


@dataclass(frozen=True)
class _Slab:
    """Between a front plane and another one behind it."""

    camera: Camera
    front: np.ndarray  # a point of the front plane, world [m], (3,)
    normal: np.ndarray  # unit, towards the camera, (3,)
    thickness: float  # [m]

    def solid(self, mask: np.ndarray) -> np.ndarray:
        """Where, seen on the front plane, the slab is solid (H, W), by its silhouette (H, W)."""
        solid = np.zeros_like(mask)
        if mask.any():
            v, u = (slice(each.min(), each.max() + 1) for each in np.nonzero(mask))
            front = np.stack(np.meshgrid(np.arange(u.start, u.stop), np.arange(v.start, v.stop)), -1).astype(float)
            rays = self.camera.rays(front)
            back = self._pixels(self.camera.position + rays * self._reach(self._towards(rays))[..., None] - self.normal * self.thickness)
            solid[v, u] = solid_columns(front, back, lambda pixels: nearest(mask, pixels) > 0, 1.0)
        return solid

    def entry(self, pixels: np.ndarray, solid: np.ndarray) -> np.ndarray:
        """Depth [m] (P,) at which the rays of pixels (P, 2) enter what is solid; 0 where they do not meet the slab."""
        rays = self.camera.rays(pixels)
        towards = self._towards(rays)
        reach, entry = self._reach(towards), np.full(len(rays), np.nan)
        for layer in np.linspace(0, self.thickness, LAYERS + 1 if self.thickness else 1):
            depth = reach + layer / towards
            column = self.camera.position + rays * depth[:, None] + self.normal * layer
            entry = np.where(np.isnan(entry) & (nearest(solid, self._pixels(column)) > 0), depth, entry)
        depth = np.where(np.isnan(entry), reach, entry)
        return np.where(depth > 0, depth, 0.0)

    def _towards(self, rays: np.ndarray) -> np.ndarray:
        """How fast rays (..., 3) go into the slab, per depth; NaN where they do not."""
        inwards = -(rays @ self.normal)
        return np.where(inwards > 1e-3, inwards, np.nan)

    def _reach(self, towards: np.ndarray) -> np.ndarray:
        """Depth [m] (...) at which rays that go `towards` the slab so fast meet its front plane."""
        return np.asarray(((self.camera.position - self.front) @ self.normal) / towards)

    def _pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3); far off where there are none."""
        return np.nan_to_num(self.camera.project(np.nan_to_num(points, nan=np.inf))[0], nan=-1e6, posinf=-1e6, neginf=-1e6)
