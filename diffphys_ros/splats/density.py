"""Adaptive density: more discs where the picture is still wrong, none where they do not show (after Kerbl et al. 2023, 5)."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from .discs import Discs
from .primitives import doubled

MIN_OPACITY = 0.05  # more transparent discs go
MIN_SHARE_PX = 0.05  # discs that cover less than so many pixels go
SPLIT_SHRINK = 1.6  # scale of a disc over that of its halves
SPLIT_OFFSET = 0.75  # of the halves from the middle, in standard deviations


def prune_and_split(discs: Discs, error: torch.Tensor, cover: torch.Tensor, count: int) -> Discs:
    """Drop discs that are transparent or hidden, then split those with the largest error until there are `count`.

    error (G,): squared residual of the picture under each disc; cover (G,): pixels that each disc fills.
    """
    keep = (discs.logit.detach().sigmoid() > MIN_OPACITY) & (cover > MIN_SHARE_PX)
    if not bool(keep.any()):
        return discs
    return doubled(discs.pick(keep), error[keep], count, _halves)


def _halves(discs: Discs) -> Discs:
    """Two discs in the place of each, side by side along its longer axis."""
    size, longer = discs.log_scale.exp().max(1)
    turn = discs.angle + longer * (math.pi / 2)
    step = torch.stack([turn.cos(), turn.sin()], 1) * (SPLIT_OFFSET * size)[:, None]
    step = (discs.pixel_from_plane @ step[..., None])[..., 0]
    smaller = discs.log_scale.clone()
    smaller[torch.arange(len(discs)), longer] -= math.log(SPLIT_SHRINK)
    sides = [replace(discs, pixel=discs.pixel + sign * step, log_scale=smaller) for sign in (1, -1)]
    return sides[0].join(sides[1])
