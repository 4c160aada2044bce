"""The unknowns of the fit: flat discs that slide, turn and stretch on the surface that frame 0 shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from ..types import Camera, Splats
from .primitives import Primitives
from .seed import Blocks, Surface

SIGMA_PER_SIDE = 0.5  # standard deviation of a new disc over the side of its block
THICKNESS = 0.1  # over the smaller standard deviation in the plane
OPACITY = 0.9  # of a new disc

Gaussians = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class Discs(Primitives):
    """G discs (torch, float32). One view says nothing of depth and tilt, so these stay as the depth image had them."""

    FREE = ("pixel", "log_scale", "angle", "logit", "color")

    pixel: torch.Tensor  # centre [px], (G, 2)
    log_scale: torch.Tensor  # of the standard deviations in the plane [m], (G, 2)
    angle: torch.Tensor  # turn about the normal [rad], (G,)
    logit: torch.Tensor  # of the opacity, (G,)
    color: torch.Tensor  # RGB, (G, 3)
    depth: torch.Tensor  # fixed [m], (G,)
    frame: torch.Tensor  # fixed: quaternion wxyz of the plane's axes, (G, 4)
    pixel_from_plane: torch.Tensor  # fixed: pixels per displacement along the plane's axes [px/m], (G, 2, 2)


def discs_of(blocks: Blocks, surface: Surface, device: str) -> Discs:
    """One disc per block."""
    quaternion = Rotation.from_matrix(surface.axes).as_quat()[:, [3, 0, 1, 2]]
    scale = np.log(surface.footprint * SIGMA_PER_SIDE * blocks.side[:, None])
    count = len(scale)
    logit = np.full(count, np.log(OPACITY / (1 - OPACITY)))
    arrays = (blocks.centre, scale, np.zeros(count), logit, blocks.color, surface.depth, quaternion, surface.pixel_from_plane)
    return Discs(*(torch.as_tensor(a, dtype=torch.float32, device=device) for a in arrays))


def gaussians(discs: Discs, camera: Camera) -> Gaussians:
    """Mean, rotation, scale, opacity and colour as the renderer takes them; differentiable."""
    pose, inverse = (discs.pixel.new_tensor(a) for a in (camera.world_from_camera, np.linalg.inv(camera.pixel_from_camera)))
    rays = torch.cat([discs.pixel, torch.ones_like(discs.pixel[:, :1])], 1) @ inverse.T @ pose[:3, :3].T
    half = discs.angle / 2
    rotation = _turned(discs.frame, torch.cos(half), torch.sin(half))
    scale = discs.log_scale.exp()
    thickness = THICKNESS * scale.detach().amin(1, keepdim=True)
    return pose[:3, 3] + rays * discs.depth[:, None], rotation, torch.cat([scale, thickness], 1), discs.logit.sigmoid(), discs.color


def leaning(discs: Discs, camera: Camera, slope: float, towards_rad: float) -> Discs:
    """The same picture, disc by disc, of a surface that leans back by `slope` in a direction of the image: discs move along their
    lines of sight and keep their size there; only which of two covers the other changes."""
    direction = discs.pixel.new_tensor([np.cos(towards_rad), np.sin(towards_rad)])
    across = (discs.pixel.detach() - discs.pixel.detach().mean(0)) @ direction / camera.focal_px
    factor = 1 + slope * across
    return replace(discs, depth=discs.depth * factor, log_scale=discs.log_scale + factor.log()[:, None])


def to_splats(discs: Discs, camera: Camera) -> Splats:
    """The discs as data."""
    with torch.no_grad():
        mean, rotation, scale, opacity, color = gaussians(discs, camera)
    return Splats(*(t.detach().cpu().numpy() for t in (mean, rotation, scale, opacity, color)))


def _turned(q: torch.Tensor, cosine: torch.Tensor, sine: torch.Tensor) -> torch.Tensor:
    """Quaternion product q * (cosine, 0, 0, sine): a turn about the local third axis."""
    w, x, y, z = q.unbind(-1)
    return torch.stack([w * cosine - z * sine, x * cosine + y * sine, y * cosine - x * sine, z * cosine + w * sine], -1)
