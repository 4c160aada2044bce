"""The place of the force, read again once a simulation knows what linear modes miss, and the fit that follows from it."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import torch

from ..modes.response import SLOWEST
from ..progress import Progress
from ..start.second_reading import read_again
from ..types import StartValues, Tracks
from .answer import linear_answer
from .checkpoint import Checkpoint, First
from .clock import Clock
from .fit import Fitted, fit
from .model import Model
from .problem import Problem, problem_on
from .stages import schedule


def fitted_again(fitted: Fitted, checkpoint: Checkpoint, clock: Clock) -> Generator[Progress, None, Fitted]:
    """`fitted`, or the fit from the place where the force is then found to act, if that explains the clip better."""
    if checkpoint.first is None:
        start = yield from _second_reading(fitted, clock)
        if start is None:
            return fitted
        checkpoint.first = First(fitted.z, fitted.value, fitted.model.problem.forward.captured, fitted.losses, start)
    model = Model(_posed(fitted.model.problem, checkpoint.first.again))
    again = yield from fit(model, schedule(model.problem), checkpoint=checkpoint, clock=clock)
    if again.value < fitted.value:
        return again
    yield Progress("fit", text=f"the force stays where it was: from the other place the loss is {again.value:.3g}, not {fitted.value:.3g}")
    return fitted


def _second_reading(fitted: Fitted, clock: Clock) -> Generator[Progress, None, StartValues | None]:
    problem = fitted.model.problem
    if not fitted.simulated or clock.stopped or "force" in problem.layout.held or any(stage.fields for stage in schedule(problem)):
        return None
    seen = _first_order(fitted)
    if seen is None:
        return None
    yield Progress("fit", text="reading the place of the force again, with what the simulation knows of the swing")
    start, tracks = seen
    prepared = problem.prepared
    refined = problem.layout.held.isdisjoint(("young", "damping"))
    again = read_again(prepared.body, tracks, prepared.clip.period_s, problem.settings, start, prepared.modal, camera=prepared.clip.camera, refined=refined)
    if again is not None:
        yield Progress("fit", text=f"the force acts elsewhere ({_placed(again)}): fitting again from there")
    return again


def _first_order(fitted: Fitted) -> tuple[StartValues, Tracks] | None:
    """The physics of the fit, and the tracks less what its linear motion misses of its simulated one; None where the linear one is nearer to
    the tracks: then a simulation so coarse knows less than the modes."""
    problem = fitted.model.problem
    start, target = as_start(fitted), problem.target
    with torch.no_grad():
        motion = fitted.model().motion
    if motion is None:
        return None
    linear = linear_answer(replace(problem.prepared, start=start), problem.disc).displacement
    tensor = problem.forward.simulator.tensor
    points = problem.objective.binding
    simulated, modal = points.apply(motion.displacement), points.apply(tensor(linear))
    begun = points.apply(tensor(linear_answer(problem.prepared, problem.disc).displacement))
    if target.loss(simulated) >= target.loss(begun):
        return None
    missed = problem.prepared.body.rotate_to_world((simulated - modal).double().cpu().numpy())
    tracks = problem.prepared.tracks
    return start, replace(tracks, points=tracks.points - missed.astype(tracks.points.dtype))


def _posed(problem: Problem, start: StartValues) -> Problem:
    """The problem begun from other start values, on the same grid."""
    prepared = replace(problem.prepared, start=start)
    return problem_on(prepared, problem.settings, problem.plan, problem.disc, problem.renderer, dtype=problem.forward.dtype)


def _placed(start: StartValues) -> str:
    """Where a force acts, for people."""
    if start.footprint.family == "uniform":
        return "on the whole body"
    x, y, sigma = 1e3 * start.footprint.parameters
    return f"about x = {x:.0f} mm, y = {y:.0f} mm of the body frame, {sigma:.0f} mm wide"


def as_start(fitted: Fitted) -> StartValues:
    """Constants per part and a vector per frame, as they are, in the place of the start values'. A damping below 0, which a simulation may have whose grid
    damps by itself, brakes the leading mode as it does and lets no other gain energy."""
    problem = fitted.model.problem
    with torch.no_grad():
        found = problem.layout.unpack(torch.as_tensor(fitted.z), modes=problem.forward.basis.shape[2])
    young = found.young.numpy() * problem.disc.apparent
    leading = max(float(problem.prepared.modal.eigen(young)[0][0]), SLOWEST**2)
    return replace(
        problem.prepared.start,
        young=young,
        damping=found.damping.numbers().braking(leading),
        force=found.force.numpy(),
        initial_displacement=found.initial_displacement.numpy(),
        initial_velocity=found.initial_velocity.numpy(),
    )
