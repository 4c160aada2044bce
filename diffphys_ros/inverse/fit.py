"""Stage after stage: the loss of a model, lowered."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from ..particles import held_by
from ..progress import ForceSoFar, Progress
from .checkpoint import Checkpoint, First, Stored
from .clock import Clock, OutOfTimeError
from .descent import Descent, Space, begin, descend
from .model import Model
from .modulus_scan import best_scale
from .stages import Stage
from .stages.constants import room
from .transitions import transitions

POOR = 0.08  # track loss at the start above which it is taken to lie in a wrong valley; 0.5 is the frozen first frame


@dataclass
class Fitted:
    """How far a fit has come; the model's tensors hold the best values."""

    model: Model
    z: np.ndarray  # of all blocks, as constants and vectors ended, (size,)
    value: float = np.inf  # of the loss; infinite where nothing could be simulated
    losses: dict[str, list[float]] = field(default_factory=dict)  # of each state, by the name of its stage

    @property
    def simulated(self) -> bool:
        """Whether material points moved the model last."""
        return bool(np.isfinite(self.value)) and self.model.engine is self.model.problem.forward


def fit(model: Model, stages: list[Stage], *, checkpoint: Checkpoint, clock: Clock) -> Generator[Progress, None, Fitted]:
    """The stages, one after the other, from where the checkpoint says that they were. Ends early where the clock says so."""
    stored, objective = checkpoint.load(model.problem.layout, len(stages)), model.problem.objective
    fitted = Fitted(model, model.problem.layout.start) if stored is None else _resumed(model, stored)
    objective.watch = clock.check
    try:
        for number in range(len(stages)):
            if stored is None or number >= stored.stage:
                before = stored.descent if stored is not None and number == stored.stage else None
                yield from _stage(fitted, stages, number, before, checkpoint, clock)
            if clock.stopped or not np.isfinite(fitted.value):
                break
    finally:
        objective.watch = None
        checkpoint.flush()
        model.problem.forward.simulator.release()  # what follows needs no gradient, or is another fit with tapes of its own
    return fitted


def ended(model: Model, first: First) -> Fitted:
    """The fit that ended before a second reading."""
    model.problem.forward.capture(first.captured)
    model.put(first.z)
    return Fitted(model, first.z, first.value, {name: list(values) for name, values in first.losses.items()})


def _resumed(model: Model, stored: Stored) -> Fitted:
    model.problem.forward.capture(stored.captured)
    model.put(stored.z)
    return Fitted(model, stored.z, stored.descent.value, {name: list(values) for name, values in stored.losses.items()})


def _stage(fitted: Fitted, stages: list[Stage], number: int, state: Descent | None, checkpoint: Checkpoint, clock: Clock) -> Generator[Progress, None, None]:
    stage, model = stages[number], fitted.model
    model.enter(stage)
    losses, total = fitted.losses.setdefault(stage.name, []), sum(s.states for s in stages if s.name == stage.name)
    until = sum(s.states for s in stages[: number + 1] if s.name == stage.name)
    space, before = model.space(stage.free), clock.spent_s
    if state is not None:
        if len(state.at) != len(space.vector()):
            raise checkpoint.another()
        space.assign(state.at)
    try:
        loss = (yield from _entered(model, stage)) if state is None and stage.way == "lbfgs" else None
        for here in islice(WAYS[stage.way](model, stage, space, state, loss, clock), max(until - len(losses), 0)):
            state = here
            losses.append(state.value)
            fitted.value = state.value
            if not stage.fields:
                fitted.z = model.z.detach().numpy().copy()
            every = {name: list(values) for name, values in fitted.losses.items()}
            checkpoint.offer(Stored(number, fitted.z, state, model.problem.forward.captured, every, checkpoint.first))
            took, before = clock.spent_s - before, clock.spent_s
            left = took * (total - len(losses)) if len(losses) > 1 else None
            yield Progress(stage.name, len(losses) - 1, total - 1, state.value, left, _words(model, stage), None if stage.fields else _force_so_far(model))
            if len(losses) < total and not state.done(stage.rules) and not clock.allows_fit(stage.spare * took):
                raise OutOfTimeError
    except OutOfTimeError:
        if state is not None:
            space.assign(state.at)
        done, whose = max(len(losses) - 1, 0), " of the fields" if stage.fields else ""
        clock.stopped = f"stopped by the time budget of {clock.limit_s:.0f} s after {done} of {total - 1} iterations{whose}; the best answer so far is kept"
        yield Progress(stage.name, text=clock.stopped)


def _states(model: Model, stage: Stage, space: Space, state: Descent | None, loss: Tensor | None, clock: Clock) -> Iterator[Descent]:
    """The state that a stage begins with, where that is new, and those after it; none is begun that is not asked for."""
    if state is None:
        assert loss is not None
        state = begin(space, loss)
        yield state
    yield from descend(space, lambda: model().total, state, stage.rules)


def _frame_by_frame(model: Model, stage: Stage, space: Space, state: Descent | None, loss: Tensor | None, clock: Clock) -> Iterator[Descent]:
    yield from transitions(model, space, state, clock)


WAYS: dict[str, Callable[[Model, Stage, Space, Descent | None, Tensor | None, Clock], Iterator[Descent]]] = {
    "lbfgs": _states,
    "transitions": _frame_by_frame,
}


def _entered(model: Model, stage: Stage) -> Generator[Progress, None, Tensor]:
    """The loss with which a stage begins; where the start values lie in a wrong valley, that of the best other moduli."""
    problem, terms = model.problem, model()
    if stage.fields or stage.engine != "mpm" or "young" not in stage.free:
        return terms.total
    if terms.motion is not None and problem.objective.track_loss(terms.motion.x) < POOR:
        return terms.total
    said = f"the start misses the motion (loss {terms.value:.3g}): trying other moduli"
    del terms  # with the history of its motion, which no gradient is asked of
    problem.forward.simulator.release()
    yield Progress(stage.name, text=said)
    start = model.z.detach().numpy().copy()
    model.put(best_scale(problem, start, room=float(room(problem, start).min())))
    there = model().total
    if not torch.isfinite(there):
        yield Progress(
            stage.name, text=f"{problem.objective.failures[-1]}; no modulus near the start keeps it there: the start values are the answer"
        )
        model.put(start)
    return there


def _words(model: Model, stage: Stage) -> str:
    """A line for people."""
    problem = model.problem
    if stage.fields:
        return f"{problem.settings.fit.material_field} material, {problem.settings.fit.force_field} force"
    young = problem.layout.young_of(model.z.detach().numpy()) * problem.disc.apparent
    values, name, unit = problem.prepared.body.scale.stiffness(young, problem.prepared.start.density)
    return f"{name} {' '.join(f'{e:.4g}' for e in values)} {unit}".rstrip()


def _force_so_far(model: Model) -> ForceSoFar:
    """The net force on the particles that are not held, as the vectors in hand have it."""
    problem = model.problem
    prepared, disc, forward = problem.prepared, problem.disc, problem.forward
    rest, volume = disc.particles.x_rest[disc.particles.own], disc.particles.volume[disc.particles.own]
    with torch.no_grad():
        amplitude = problem.layout.unpack(model.z.to(forward.device, forward.dtype), modes=forward.basis.shape[2]).force.cpu().numpy().astype(float)
    lever = float((prepared.start.footprint.weights(rest) * volume * ~held_by(disc.grid, rest)).sum())
    net = prepared.body.rotate_to_world(amplitude) * lever
    centre = prepared.body.to_world(np.average(rest, axis=0, weights=volume))
    clip, scale, mass = prepared.clip, prepared.body.scale, float(volume @ disc.particles.density[disc.particles.own])
    frame_id = clip.camera.world_frame_id or clip.camera.frame_id
    return ForceSoFar(clip.start_ns, clip.period_s, frame_id, tuple(centre.tolist()), float(volume.sum()), tuple(map(tuple, net.tolist())), mass, scale.density, scale.length)
