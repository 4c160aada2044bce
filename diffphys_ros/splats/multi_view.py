"""Gaussians fitted to many pictures: a still scene from all around (paper section 4.1), or the frames of a clip whose motion is known."""

from __future__ import annotations

from collections.abc import Generator, Sequence

import numpy as np

from ..config import Settings
from ..types import Splats
from .descent import ASKED, DescentPlan, descend
from .ellipsoids import ellipsoids_of, to_splats
from .group import groups_of
from .ply import canonical
from .seed import BLOCKS_DB, MOST, count_blocks
from .view import View, check_views

GROW_AT = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)  # shares of the iterations after which Gaussians are pruned and grow in number
RATES = {"offset": 0.2, "log_scale": 0.06, "rotation": 0.06, "logit": 0.15, "color": 0.03}  # Adam steps [size, -, -, -, -]
NEAR_RATE = 0.2  # of the steps where the start is near
LAST_RATE = 0.05  # of the steps at the end over those at the start
SIDES = 2  # of an object, of which one view sees one


def fit_views(
    views: Sequence[View],
    start: Splats,
    settings: Settings,
    device: str = "cpu",
    *,
    iterations: int | None = None,
    count: int | None = None,
    near: bool = False,
) -> Generator[tuple[int, int, float], None, Splats]:
    """Gaussians of all views; yields (iteration, iterations, loss) and returns canonical Splats, frame 0 where views move.

    start: Gaussians of frame 0, or from_points(points, colors) of a sparse cloud. iterations: steps, each of one view (of up to four
    that share a camera on CUDA); None: experiment.view_iterations. count: most Gaussians; None: experiment.max_splats, where that is 0 what
    BLOCKS_DB asks for in the view with most detail, from both sides; no less than start has. near: start is near to the pictures:
    steps are smaller and the Gaussians stay who they are. A view's motion is asked again whenever their number changes; between, each
    moves with its anchor.
    Raises InputError where no view shows the object or a picture has another size than its camera.
    """
    views = check_views(views)
    iterations = settings.experiment.view_iterations if iterations is None else iterations
    if count is None:
        count = max(settings.experiment.max_splats or _chosen(views), len(start.mean))
    rates = {name: (NEAR_RATE if near else 1.0) * rate for name, rate in RATES.items()}
    counts = {} if near else _growing(len(start.mean), count, iterations)
    plan = DescentPlan(iterations, rates, LAST_RATE, settings.experiment.ssim_weight, settings.experiment.seed, counts)
    return canonical(to_splats((yield from descend(ellipsoids_of(start, device), groups_of(views, device), plan))))


def _growing(first: int, last: int, iterations: int) -> dict[int, int]:
    """Most Gaussians from an iteration on: evenly from the first ones on to the last."""
    return {round(at * iterations): round(first + k / len(GROW_AT) * (last - first)) for k, at in enumerate(GROW_AT, 1) if round(at * iterations)}


def _chosen(views: Sequence[View]) -> int:
    few = views[:: -(-len(views) // ASKED)]
    blocks = max(count_blocks(v.image.astype(np.float32) / 255, v.mask, BLOCKS_DB, MOST) for v in few)
    return min(SIDES * blocks, MOST)
