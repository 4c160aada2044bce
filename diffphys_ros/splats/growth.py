"""Adaptive density of free Gaussians: those that do not show go, those under which the pictures are wrong become two (Kerbl et al.
2023, 5.2; the residual decides as in Rota Bulo et al. 2024, "Revising densification in Gaussian splatting")."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from .density import MIN_OPACITY, MIN_SHARE_PX, SPLIT_OFFSET, SPLIT_SHRINK
from .ellipsoids import Ellipsoids, rotated
from .primitives import doubled

LARGEST = 0.3  # standard deviation over the width of the picture from which a Gaussian is fog


def prune_and_grow(e: Ellipsoids, error: torch.Tensor, cover: torch.Tensor, spread: torch.Tensor, *, count: int) -> Ellipsoids:
    """Drop Gaussians that are faint, hidden or oversized, then double those with the largest error until there are `count`.

    error (G,): squared residual of the pictures under each Gaussian; cover (G,): pixels that each fills where it shows most;
    spread (G,): largest standard deviation over the width of the picture where it looks largest.
    """
    keep = (e.logit.detach().sigmoid() > MIN_OPACITY) & (cover > MIN_SHARE_PX) & (spread < LARGEST)
    if not bool(keep.any()):
        return e
    e = e.pick(keep)
    middle = e.log_scale.amax(1).median()
    return doubled(e, error[keep], count, lambda chosen: _two(chosen, middle))


def _two(e: Ellipsoids, middle: torch.Tensor) -> Ellipsoids:
    """Two Gaussians in the place of each, side by side along its longest axis: halves of those larger than the middle one, of the
    others two of the same size that together hide as much."""
    longest, axis = e.log_scale.max(1)
    rows, large = torch.arange(len(e), device=axis.device), longest > middle
    along = torch.zeros_like(e.anchor)
    along[rows, axis] = SPLIT_OFFSET * longest.exp()
    step = rotated(torch.nn.functional.normalize(e.rotation, dim=1), along) / e.size
    log_scale = e.log_scale.clone()
    log_scale[rows, axis] -= torch.where(large, math.log(SPLIT_SHRINK), 0.0)
    passed = (1 - e.logit.sigmoid()).clamp_min(1e-6).sqrt()
    logit = torch.where(large, e.logit, torch.logit(1 - passed))
    sides = [replace(e, offset=e.offset + sign * step, log_scale=log_scale, logit=logit) for sign in (1, -1)]
    return sides[0].join(sides[1])
