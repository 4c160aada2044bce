"""The unknowns of the fit to frame 0: flat discs that slide, turn and stretch on the surface that it shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from ..rotations import product, quaternion_of
from ..types import Camera
from .primitives import Primitives, Tensors
from .seed import Blocks, Surface
from .view import View

SIGMA_PER_SIDE = 0.5  # standard deviation of a new disc over the side of its block
THICKNESS = 0.1  # over the smaller standard deviation in the plane
OPACITY = 0.9  # of a new disc
LEAN = 0.06  # slope of depth across the line of sight, in a direction that is new in every step


@dataclass(frozen=True)
class Discs(Primitives):
    """G discs (torch, float32). One view says nothing of depth and tilt, so these stay as the depth image had them."""

    FREE = ("pixel", "log_scale", "angle", "logit", "color")

    log_scale: torch.Tensor  # of the standard deviations in the plane [m], (G, 2)
    logit: torch.Tensor  # of the opacity, (G,)
    pixel: torch.Tensor  # centre [px], (G, 2)
    angle: torch.Tensor  # turn about the normal [rad], (G,)
    color: torch.Tensor  # RGB, (G, 3)
    depth: torch.Tensor  # fixed [m], (G,)
    frame: torch.Tensor  # fixed: quaternion wxyz of the plane's axes, (G, 4)
    pixel_from_plane: torch.Tensor  # fixed: pixels per displacement along the plane's axes [px/m], (G, 2, 2)

    def standing(self, views: Sequence[View]) -> Callable[[Discs, list[int]], Tensors]:
        """In the one camera through which they are unknowns."""
        camera = views[0].camera

        def there(discs: Discs, index: list[int]) -> Tensors:
            mean, rotation, scale, opacity, color = gaussians(discs, camera)
            return mean.expand(len(index), -1, -1), rotation.expand(len(index), -1, -1), scale, opacity, color

        return there

    def disturbed(self, camera: Camera, generator: torch.Generator) -> Discs:
        """Discs overlap, and the nearer one covers the other. Fitted in one order alone, they would lean on it: when the surface turns
        by a few degrees, every disc covers its neighbour on one side and the texture seems to shift by half a pixel. So each step sees
        them in the order of a surface that leans some other way."""
        return leaning(self, camera, LEAN, 2 * torch.pi * float(torch.rand((), generator=generator)))

    def stepped(self, axis: torch.Tensor, length: torch.Tensor) -> Discs:
        """Slid along an axis of their own, by so many metres."""
        turn = self.angle + axis * (math.pi / 2)
        step = torch.stack([turn.cos(), turn.sin()], 1) * length[:, None]
        return replace(self, pixel=self.pixel + (self.pixel_from_plane @ step[..., None])[..., 0])


def discs_of(blocks: Blocks, surface: Surface, device: str) -> Discs:
    """One disc per block."""
    count = len(blocks.centre)
    arrays = {
        "pixel": blocks.centre,
        "log_scale": np.log(surface.footprint * SIGMA_PER_SIDE * blocks.side[:, None]),
        "angle": np.zeros(count),
        "logit": np.full(count, np.log(OPACITY / (1 - OPACITY))),
        "color": blocks.color,
        "depth": surface.depth,
        "frame": quaternion_of(torch.as_tensor(surface.axes)),
        "pixel_from_plane": surface.pixel_from_plane,
    }
    return Discs(**{name: torch.as_tensor(a, dtype=torch.float32, device=device) for name, a in arrays.items()})


def gaussians(discs: Discs, camera: Camera) -> Tensors:
    """Mean, rotation, scale, opacity and colour as the renderer takes them; differentiable."""
    pose, inverse = (discs.pixel.new_tensor(a) for a in (camera.world_from_camera, np.linalg.inv(camera.pixel_from_camera)))
    rays = torch.cat([discs.pixel, torch.ones_like(discs.pixel[:, :1])], 1) @ inverse.T @ pose[:3, :3].T
    half, none = discs.angle / 2, torch.zeros_like(discs.angle)
    rotation = product(discs.frame, torch.stack([torch.cos(half), none, none, torch.sin(half)], -1))
    scale = discs.log_scale.exp()
    thickness = THICKNESS * scale.detach().amin(1, keepdim=True)
    return pose[:3, 3] + rays * discs.depth[:, None], rotation, torch.cat([scale, thickness], 1), discs.logit.sigmoid(), discs.color


def spread(discs: Discs, most_px: float, camera: Camera, *, seed: int) -> Discs:
    """The same picture, disc by disc, with depths that lie by chance up to `most_px` pixels' width before and behind the surface: which of two covers
    the other is then settled for every surface that turns by less than their depths differ."""
    chance = np.random.default_rng(seed).uniform(-most_px, most_px, len(discs))
    return _moved_along_sight(discs, 1 + discs.depth.new_tensor(chance) / camera.focal_px)


def leaning(discs: Discs, camera: Camera, slope: float, towards_rad: float) -> Discs:
    """The same picture, disc by disc, of a surface that leans back by `slope` in a direction of the image: discs move along their
    lines of sight and keep their size there; only which of two covers the other changes."""
    direction = discs.pixel.new_tensor([np.cos(towards_rad), np.sin(towards_rad)])
    across = (discs.pixel.detach() - discs.pixel.detach().mean(0)) @ direction / camera.focal_px
    return _moved_along_sight(discs, 1 + slope * across)


def _moved_along_sight(discs: Discs, factor: torch.Tensor) -> Discs:
    """Depths (G,) times a factor each, as large as before in the picture."""
    return replace(discs, depth=discs.depth * factor, log_scale=discs.log_scale + factor.log()[:, None])
