"""Adaptive density: Gaussians that do not show go, those under which the pictures are wrong become two (Kerbl et al. 2023, 5.2; the
residual decides as in Rota Bulo et al. 2024, "Revising densification in Gaussian splatting")."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch

from .primitives import AnyPrimitives

MIN_OPACITY = 0.05  # more transparent Gaussians go
MIN_SHARE_PX = 0.05  # those that cover less than so many pixels go
LARGEST = 0.3  # standard deviation over the width of the picture from which a Gaussian is fog
SPLIT_SHRINK = 1.6  # scale of a Gaussian over that of its halves
SPLIT_OFFSET = 0.75  # of the halves from the middle, in standard deviations


@dataclass(frozen=True)
class Shown:
    """What the pictures say of each of G Gaussians."""

    error: torch.Tensor  # squared residual of the pictures under it, (G,)
    cover: torch.Tensor  # pixels that it fills where it shows most, (G,)
    spread: torch.Tensor  # largest standard deviation over the width of the picture where it looks largest, (G,)


def prune_and_double(what: AnyPrimitives, shown: Shown, count: int) -> AnyPrimitives:
    """Drop Gaussians that are faint, hidden or oversized, then double those with the largest error until there are `count` or twice as
    many. Where none would be left, all stay as they are."""
    keep = (what.logit.detach().sigmoid() > MIN_OPACITY) & (shown.cover > MIN_SHARE_PX) & (shown.spread < LARGEST)
    if not bool(keep.any()):
        return what
    what, error = what.pick(keep), shown.error[keep]
    room = min(max(count - len(what), 0), len(what))
    chosen = torch.zeros_like(keep[keep])
    chosen[torch.argsort(error, descending=True, stable=True)[:room]] = True
    return what.pick(~chosen).join(_two(what.pick(chosen), what.halved[chosen]))


def _two(what: AnyPrimitives, halved: torch.Tensor) -> AnyPrimitives:
    """Two Gaussians in the place of each, side by side along its longest axis: halves (G,), or two of the same size that together hide
    as much."""
    longest, axis = what.log_scale.max(1)
    log_scale = what.log_scale.clone()
    log_scale[torch.arange(len(what), device=axis.device), axis] -= torch.where(halved, math.log(SPLIT_SHRINK), 0.0)
    passed = (1 - what.logit.sigmoid()).clamp_min(1e-6).sqrt()
    logit = torch.where(halved, what.logit, torch.logit(1 - passed))
    sides = [replace(what.stepped(axis, sign * SPLIT_OFFSET * longest.exp()), log_scale=log_scale, logit=logit) for sign in (1, -1)]
    return sides[0].join(sides[1])
