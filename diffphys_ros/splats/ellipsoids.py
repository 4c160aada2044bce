"""The unknowns of a fit to many views: Gaussians that are free in space."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from ..errors import InputError
from ..rotations import product, rotated
from ..types import Splats
from .primitives import Primitives, Tensors, as_splats
from .view import View

NEIGHBOURS = 3  # whose distance sizes a Gaussian of a point (Kerbl et al. 2023, 5.1)
POINT_OPACITY = 0.5  # of a Gaussian of a point
OPACITY_RANGE = 1e-4, 1 - 1e-4  # keeps logits finite


@dataclass(frozen=True)
class Ellipsoids(Primitives):
    """G Gaussians (torch, float32), world frame. A step of the mean counts in the Gaussian's own size."""

    FREE = ("offset", "log_scale", "rotation", "logit", "color")

    log_scale: torch.Tensor  # of the standard deviations [m], (G, 3)
    logit: torch.Tensor  # of the opacity, (G,)
    offset: torch.Tensor  # of the mean from the anchor [size], (G, 3)
    rotation: torch.Tensor  # quaternion wxyz of any norm, (G, 4)
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

    def standing(self, views: Sequence[View]) -> Callable[[Ellipsoids, list[int]], Tensors]:
        """Each moves with its anchor; where the anchors are is asked now."""
        place, turn = _carried(self.anchor, views)

        def there(e: Ellipsoids, index: list[int]) -> Tensors:
            mean, rotation = place[index], e.rotation.expand(len(index), *e.rotation.shape)
            if turn is None:
                mean = mean + e.shift
            else:
                mean, rotation = mean + rotated(turn[index], e.shift.expand(mean.shape)), product(turn[index], rotation)
            return mean, rotation, e.log_scale.exp(), e.logit.sigmoid(), e.color

        return there

    @property
    def unmoved(self) -> Ellipsoids:
        """With their means at their anchors."""
        return replace(self, offset=torch.zeros_like(self.offset))

    def stepped(self, axis: torch.Tensor, length: torch.Tensor) -> Ellipsoids:
        """Moved along an axis of their own, by so many metres."""
        along = torch.zeros_like(self.anchor)
        along[torch.arange(len(self), device=axis.device), axis] = length
        return replace(self, offset=self.offset + rotated(torch.nn.functional.normalize(self.rotation, dim=1), along) / self.size)

    @property
    def halved(self) -> torch.Tensor:
        """Those larger than the middle one."""
        longest = self.log_scale.amax(1)
        return longest > longest.median()


def _carried(anchor: torch.Tensor, views: Sequence[View]) -> tuple[torch.Tensor, torch.Tensor | None]:
    """Where anchors (G, 3) [m] are in the views, (V, G, 3), and their turn, wxyz, (V, G, 4); None where no view moves."""
    moves = [view.motion for view in views]
    if all(move is None for move in moves):
        return anchor.expand(len(moves), *anchor.shape), None
    still = torch.zeros_like(anchor), anchor.new_tensor([1.0, 0, 0, 0]).expand(len(anchor), 4)
    with torch.no_grad():
        shift, turn = zip(*(still if move is None else move(anchor) for move in moves), strict=True)
    return anchor + torch.stack(shift), torch.stack(turn)


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
    return Ellipsoids(scale.log(), logit, torch.zeros_like(mean), rotation, color, mean, torch.ones_like(mean[:, :1])).leaves()


def to_splats(ellipsoids: Ellipsoids) -> Splats:
    """The Gaussians of frame 0 as data."""
    e = ellipsoids
    rotation = torch.nn.functional.normalize(e.rotation, dim=1)
    return as_splats((e.anchor + e.shift, rotation, e.log_scale.exp(), e.logit.sigmoid(), e.color.clamp(0, 1)))
