"""The whole job: the only room that sees every stage. The loop reads like the paper's equation 3."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

from ..config import Settings
from ..devices import usable
from ..progress import Progress
from ..types import Clip, Recovery, Splats
from .checkpoint import Checkpoint
from .clock import Clock
from .evidence.pixels import static_background
from .explaining import calls_for_fields, carried_by_fields, lengthened, may_carry, modes_miss, shortened
from .frame_metrics import Judge
from .gaussians import fit_gaussians
from .prepare import label, prepare
from .prepared import Prepared
from .prescribed import told_by
from .refine import refine_gaussians
from .resolution import longest_budget_s, time_budget_s
from .solve import solve
from .stages import require_schedule
from .uncovered import uncover

__all__ = ["Checkpoint", "Clock", "Judge", "Prepared", "Progress", "clock_of", "fit_gaussians", "label", "prepare", "refine_gaussians", "run", "solve", "solve_prepared"]

Steps = Generator[Progress, None, tuple[Prepared, Splats, Recovery]]


def clock_of(settings: Settings, *, side_by_side: int = 1) -> Clock:
    """The clock of a run that begins now. Runs that share the machine have so many times the time each, and plan as one that is alone; a run
    whose iterations are told is not stopped."""
    if settings.fit.iterations:
        return Clock()
    limit_s, longest_s = (side_by_side * budget(settings, usable(settings.fit.device)) for budget in (time_budget_s, longest_budget_s))
    return Clock(limit_s, longest_s=longest_s)


def run(
    source: Clip | str | Path,
    settings: Settings,
    *,
    splats: Splats | None = None,
    checkpoint: Checkpoint | None = None,
    clock: Clock | None = None,
    guess_scale: float = 1.0,
) -> Steps:
    """Clip, or the path of a recording, in; fields out. Of a recording the frames of settings.frames are read, a clip is taken whole. Gaussians
    of frame 0 are fitted where none are given, and where the body is that of another frame. The search for start values begins `guess_scale`
    times off, which it must forget. Yields news, returns (Prepared, Splats, Recovery)."""
    _require(settings)
    clock = clock or clock_of(settings)
    judge = Judge.of(settings, device=usable(settings.fit.device))
    if not isinstance(source, Clip):
        from ..bags.read import read_clip

        yield Progress("reading", text=str(source))
        source = read_clip(source, settings, frames=settings.frames)
    if checkpoint is not None:
        checkpoint.bind(source, settings, begun=guess_scale)
    prepared = yield from prepare(source, settings, guess_scale=guess_scale)
    return (yield from _solved(prepared, settings, judge, splats, checkpoint, clock))


def solve_prepared(
    prepared: Prepared, settings: Settings, *, checkpoint: Checkpoint | None = None, clock: Clock | None = None, start_scale: float = 1.0
) -> Steps:
    """The part of the job that needs only torch, numpy, scipy and Warp. The solver begins `start_scale` times off the start values."""
    _require(settings)
    clock = clock or clock_of(settings)
    judge = Judge.of(settings, device=usable(settings.fit.device))
    if checkpoint is not None:
        checkpoint.bind(prepared.clip, settings, begun=start_scale)
    return (yield from _solved(prepared, settings, judge, None, checkpoint, clock, start_scale))


def _require(settings: Settings) -> None:
    """Refuses, before anything is fitted, what the settings alone say of schedule, unknowns and prescribed result. Raises InputError."""
    require_schedule(settings)
    told_by(settings)


def _solved(
    prepared: Prepared, settings: Settings, judge: Judge, splats: Splats | None, checkpoint: Checkpoint | None, clock: Clock, start_scale: float = 1.0
) -> Steps:
    behind = static_background(prepared.clip, edge_px=settings.experiment.splat_edge_px)
    if splats is None or prepared.hanging is not None:  # the body hangs as in another frame
        splats = yield from fit_gaussians(prepared.clip, prepared.depth0, settings, behind=behind)
    may = may_carry(prepared, settings)
    first, ends = settings, clock
    if may and modes_miss(prepared):
        settings, clock = lengthened(settings, clock)
        first, ends = shortened(settings, clock)
    recovery = yield from solve(prepared, splats, first, behind=behind, checkpoint=checkpoint, clock=ends, start_scale=start_scale)
    if may and calls_for_fields(prepared, recovery):
        settings, clock = lengthened(settings, clock)
        prepared, splats, recovery, behind = yield from carried_by_fields(prepared, splats, recovery, behind, settings, clock)
    splats, behind, recovery = yield from uncover(prepared, splats, recovery, settings, behind=behind, clock=clock)
    splats, recovery = yield from refine_gaussians(prepared, splats, recovery, settings, behind=behind, clock=clock)
    return prepared, splats, judge.judged(recovery, prepared)
