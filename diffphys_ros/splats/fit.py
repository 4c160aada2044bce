"""Static Gaussians of frame 0 (paper section 3.2): discs back-projected from depth, then fitted to the one picture."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import torch

from ..config import Settings
from ..errors import InputError
from ..types import Camera, Splats, object_mask
from .descent import DescentPlan, descend
from .discs import Discs, discs_of, gaussians, spread
from .group import Group, cropped
from .ply import canonical
from .primitives import as_splats
from .seed import BLOCKS_DB, MOST, count_blocks, gather_blocks, surface_at
from .view import View

FIRST_SHARE = 0.75  # of the count that the fit starts with; splitting adds the rest
SPLIT_AT = (0.25, 0.5)  # shares of the iterations after which discs are pruned and split
RATES = {"pixel": 0.2, "log_scale": 0.06, "angle": 0.05, "logit": 0.1, "color": 0.005}  # Adam steps [px, -, rad, -, -]
LAST_RATE = 0.1  # of the steps at the end over those at the start


def fit_splats(
    image0: np.ndarray, labels0: np.ndarray, depth0: np.ndarray, camera: Camera, settings: Settings, device: str = "cpu", *, behind: np.ndarray | None = None
) -> Generator[tuple[int, int, float], None, Splats]:
    """Gaussians of the object in frame 0; yields (iteration, iterations, loss) and returns canonical Splats.

    image0 uint8 (H, W, 3), labels0 (H, W) (255 is neither fitted nor painted), depth0 (H, W) [m, 0 where unknown]; behind uint8 (H, W, 3): the scene
    without the object, None: the picture around it.
    Raises InputError where the mask is empty or no masked pixel has a depth.
    """
    mask = object_mask(labels0)
    if not mask.any():
        raise InputError("mask: frame 0 shows no object; give scene.first_mask")
    image, count, iterations = image0.astype(np.float32) / 255, settings.experiment.max_splats, settings.experiment.splat_iterations
    if not count:
        count = round(count_blocks(image, mask, BLOCKS_DB, int(FIRST_SHARE * MOST)) / FIRST_SHARE)
    blocks = gather_blocks(image, mask, max(int(FIRST_SHARE * count), 1))
    discs = discs_of(blocks, surface_at(blocks.centre, depth0, mask, camera), device)
    discs = spread(discs, settings.experiment.splat_spread_px, camera, seed=settings.experiment.seed).leaves()
    group = Group.of([View(image0, camera, labels0, behind, edge_px=settings.experiment.splat_edge_px)], device)
    known = np.where(mask & np.isfinite(depth0) & (depth0 > 0), depth0, 0).astype(np.float32)
    depth = torch.as_tensor(np.ascontiguousarray(cropped(known, group.window)), device=device)
    counts = {round(share * iterations): count for share in SPLIT_AT}
    plan = DescentPlan(iterations, RATES, LAST_RATE, settings.experiment.ssim_weight, settings.experiment.seed, counts)
    discs = yield from descend(discs, [group], plan, settled=lambda discs: _onto_depth(discs, group, depth))
    with torch.no_grad():
        return canonical(as_splats(gaussians(discs, camera)))


def _onto_depth(discs: Discs, group: Group, depth: torch.Tensor) -> Discs:
    """Move each disc along its line of sight by what the picture's depth lacks there (h, w) [m, 0 where unknown]: where discs overlap,
    the nearer one shows, so that discs on the surface would look nearer than the surface."""
    known = depth > 0
    lacking, share = group.under(
        discs.standing(group.views)(discs, [0]), 0, lambda _, shown: (torch.where(known, depth - shown, 0.0), known.float())
    )
    return replace(discs, depth=discs.depth + lacking / share.clamp_min(1e-3))
