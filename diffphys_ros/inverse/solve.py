"""The inverse solver: from start values and Gaussians to the recovered fields (paper Eq. 3 and 10)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import torch

from ..config import Settings
from ..devices import usable
from ..progress import Progress
from ..types import Recovery, Splats
from .checkpoint import Checkpoint
from .choice import answered, verdict
from .clock import Clock
from .fit import ended, fit
from .model import Model
from .prepared import Prepared, bounces
from .prescribed import prescribed, push_as_told, told_by
from .problem import Problem, pose_problem
from .published import as_published
from .second_reading import fitted_again
from .stages import schedule
from .zones import divided, in_parts, zones_of

MATERIAL = ("young", "density", "poisson")


def solve(
    prepared: Prepared,
    splats: Splats | None,
    settings: Settings,
    *,
    behind: np.ndarray | None = None,
    checkpoint: Checkpoint | None = None,
    clock: Clock | None = None,
    start_scale: float = 1.0,
) -> Generator[Progress, None, Recovery]:
    """Joint fit over material and force, begun `start_scale` times off the start values. behind uint8 (H, W, 3): the scene without the object, None:
    it is read from the clip. Yields news, returns the Recovery; to stop
    iterating is to cancel. Where the clock stops it, the best answer so far is returned, and says so."""
    checkpoint, clock = checkpoint or Checkpoint(None), clock or Clock()
    checkpoint.bind(prepared.clip, settings, begun=start_scale)
    settings = suited(prepared, settings)
    told = told_by(settings)
    prepared = prescribed(prepared, settings, told)
    if settings.experiment.published:
        prepared = as_published(prepared, settings)
    zones = None if settings.experiment.published else (yield from zones_of(prepared, settings))
    yield Progress("plan", text="choosing cells and particles")
    _repeatable(usable(settings.fit.device))
    problem = pose_problem(divided(prepared, zones), splats, settings, behind=behind, start_scale=start_scale)
    push_as_told(problem, settings, told)
    yield Progress("plan", text=_described(problem))
    model = Model(problem)
    if checkpoint.first is None:
        fitted = yield from fit(model, schedule(problem), checkpoint=checkpoint, clock=clock)
    else:
        fitted = ended(model, checkpoint.first)
    fitted = yield from fitted_again(fitted, checkpoint, clock)
    yield Progress("result", text="final simulation and rendering")
    recovery = in_parts(answered(fitted, clock), zones)
    yield Progress("result", text=verdict(recovery))
    return recovery


def suited(prepared: Prepared, settings: Settings) -> Settings:
    """With the schedule that auto stands for where an outline was followed: its small motions are linear. Of what bounces on a floor the material is that
    of the first answer, for the bounces tell more of the floor than of it."""
    if settings.experiment.schedule != "auto":
        return settings
    if bounces(prepared.body, settings.scene):
        return replace(settings, fit=replace(settings.fit, hold=[*dict.fromkeys((*(settings.fit.hold or ()), *MATERIAL))]))
    if prepared.hanging is None:
        return settings
    return replace(settings, experiment=replace(settings.experiment, schedule="linear"))


def _repeatable(device: str) -> None:
    """Equal input gives equal bits on the CPU: the backward pass of a gather would else add from several threads in any order."""
    torch.set_deterministic_debug_mode("error" if device == "cpu" else "default")  # use_deterministic_algorithms imports torch's compiler, which takes seconds
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # that would only cost time


def _described(problem: Problem) -> str:
    plan, disc = problem.plan, problem.disc
    if not plan.simulates:
        return plan.text()
    grid = f"apparent stiffness {disc.apparent:.3f}, after which the grid's own error of log10 E is {disc.expected_log10_error:.3f}"
    return f"{plan.text()}; {len(disc.particles.own)} particles, {grid}"
