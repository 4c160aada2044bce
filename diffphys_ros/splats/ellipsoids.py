"""The unknowns of a fit to many views: Gaussians that are free in space."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from ..errors import InputError
from ..types import Splats
from .primitives import Primitives

NEIGHBOURS = 3  # whose distance sizes a Gaussian of a point (Kerbl et al. 2023, 5.1)
POINT_OPACITY = 0.5  # of a Gaussian of a point
OPACITY_RANGE = 1e-4, 1 - 1e-4  # keeps logits finite


@dataclass(frozen=True)
class Ellipsoids(Primitives):
    """G Gaussians (torch, float32), world frame. A step of the mean counts in the Gaussian's own size."""

    FREE = ("offset", "log_scale", "rotation", "logit", "color")

    offset: torch.Tensor  # of the mean from the anchor [size], (G, 3)
    log_scale: torch.Tensor  # of the standard deviations [m], (G, 3)
    rotation: torch.Tensor  # quaternion wxyz of any norm, (G, 4)
    logit: torch.Tensor  # of the opacity, (G,)
    color: torch.Tensor  # RGB, (G, 3)
    anchor: torch.Tensor  # fixed [m], (G, 3)
    size: torch.Tensor  # fixed [m], (G, 1)

    @property
    def shift(self) -> torch.Tensor:
        """Of the means from their anchors [m], (G, 3)."""
        return self.offset * self.size

    def leaves(self) -> Ellipsoids:
        """The same Gaussians, anchored where they are, with fresh unknowns that require gradients."""
        anchor = (self.anchor + self.shift).detach()
        size = self.log_scale.detach().mean(1, keepdim=True).exp()
        unit = torch.nn.functional.normalize(self.rotation.detach(), dim=1)
        return super(Ellipsoids, replace(self, offset=torch.zeros_like(anchor), rotation=unit, anchor=anchor, size=size)).leaves()


def from_points(points: np.ndarray, colors: np.ndarray) -> Splats:
    """Round Gaussians at points (N, 3) [m, world], as large as the rms distance of their three nearest neighbours (Kerbl et al.
    2023, 5.1); colors (N, 3) RGB, uint8 or 0..1. Raises InputError for fewer than two points and for numbers that are not finite."""
    if len(points) < 2 or not np.isfinite(points).all():
        raise InputError(f"points: {len(points)} given, of which all must be finite and at least 2; give the sparse cloud of a capture")
    distance = np.atleast_2d(cKDTree(points).query(points, k=min(NEIGHBOURS + 1, len(points)))[0])[:, 1:]
    size = np.sqrt((distance**2).mean(1))
    size = np.maximum(size, 1e-3 * np.median(size[size > 0]) if (size > 0).any() else 1e-6)  # for points that coincide
    rgb = colors / 255 if colors.dtype == np.uint8 else colors
    count = len(points)
    arrays = (points, np.tile([1.0, 0, 0, 0], (count, 1)), np.repeat(size[:, None], 3, 1), np.full(count, POINT_OPACITY), rgb)
    return Splats(*(np.asarray(a, np.float32) for a in arrays))


def ellipsoids_of(splats: Splats, device: str) -> Ellipsoids:
    """Gaussians as unknowns."""
    mean, rotation, scale, opacity, color = (torch.as_tensor(a, dtype=torch.float32, device=device) for a in vars(splats).values())
    logit = torch.logit(opacity.clamp(*OPACITY_RANGE))
    return Ellipsoids(torch.zeros_like(mean), scale.log(), rotation, logit, color, mean, torch.ones_like(mean[:, :1])).leaves()


def to_splats(ellipsoids: Ellipsoids) -> Splats:
    """The Gaussians as data."""
    e = ellipsoids
    rotation = torch.nn.functional.normalize(e.rotation, dim=1)
    tensors = (e.anchor + e.shift, rotation, e.log_scale.exp(), e.logit.sigmoid(), e.color.clamp(0, 1))
    return Splats(*(t.detach().cpu().numpy() for t in tensors))


def product(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Quaternion product (..., 4), wxyz."""
    w, v, scalar, vector = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    real = w * scalar - (v * vector).sum(-1, keepdim=True)
    return torch.cat([real, w * vector + scalar * v + torch.linalg.cross(v, vector)], -1)


def rotated(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
    """Vectors (..., 3) turned by unit quaternions wxyz (..., 4)."""
    twice = 2 * torch.linalg.cross(q[..., 1:], v)
    return v + q[..., :1] * twice + torch.linalg.cross(q[..., 1:], twice)
