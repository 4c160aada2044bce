"""Fields with many parameters, trained from where the search over few has ended (paper section 3.5, A.12).

First the force alone while the material stays as it is, then both: a force that may do anything would else explain the motion
at any stiffness. The search's answer is the start, so that a field only has to say what constants and vectors do not.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from ..config import Fit
from ..errors import SimulationError
from ..fields import FORCE_FIELDS, MATERIAL_FIELDS, Believed, Bounds, Box, Material, Smoothness, pretrain
from ..simulate.stability import wave_speed
from .belief import on_points
from .checkpoint import Checkpoint, Stored, Training
from .clock import Clock
from .forward import reach_of
from .limited_memory import Descent, Space, descend
from .minimise import Iterate
from .objective import Prior, Terms
from .progress import Progress

if TYPE_CHECKING:
    from .solve import Problem

SPAN = 30.0  # factor about the search's moduli within which E may lie
WARM_UP = 0.25  # share of the iterations in which the material rests, where the search has not fitted such a force before
VARIATION_SD = 0.3  # prior standard deviation of log10 E about the search's constants, beside theirs
FORCE = 1e-4  # weight of the mean square force of a field, in its unit
POISSON_SD = 0.05  # prior standard deviation of nu: motion hardly tells it


@dataclass
class Trained:
    """The fields at their best."""

    terms: Terms
    summary: dict[str, Any]  # for metrics.json


@dataclass
class FieldModel:
    """Parameters of the fields -> loss."""

    problem: Problem
    z: np.ndarray  # the search's answer, (size,)
    words: dict[str, str] = field(init=False)

    def __post_init__(self) -> None:
        fit, forward = self.problem.settings.fit, self.problem.forward
        self.words = {"material": fit.material_field, "force": fit.force_field}
        self.x, self.frames = forward.simulator.x_rest, torch.arange(len(self.problem.prepared.clip) - 1, device=forward.device)
        self.base = _base(self.problem, self.z)
        self.bounds = _bounds(self.problem, self.base)
        generator = torch.Generator().manual_seed(fit.seed)
        place = forward.simulator.options
        self.material = MATERIAL_FIELDS[fit.material_field](self.base, self.bounds, generator=generator).to(**place)
        self.follows = fit.force_frame == "rest"
        box, unit = Box.around(self.base.points if self.follows else _passed(self.problem)), self.problem.layout.force_unit
        self.force = FORCE_FIELDS[fit.force_field](box, len(self.frames), unit, generator=generator).to(**place)
        self.start = Material(*(value.detach() for value in self.base.at(self.x)))
        if fit.material_field == "triplane":
            pretrain(self.material, self.x, self.start, self.bounds)
        free = np.r_[np.arange(self.problem.layout.size)[self.problem.layout.motion_slice], self.problem.layout.parts, self.problem.layout.parts + 1]
        self.free, self.whole = torch.as_tensor(free), torch.as_tensor(self.z, dtype=torch.float64)
        self.motion = torch.nn.Parameter(self.whole[self.free].clone())
        self.smoothness = Smoothness.of(self.base.points, device=forward.device)
        self.allowed = forward.simulator.tensor(_allowed(self.problem))[:, None, None]
        self.tightness = forward.simulator.tensor(_tightness(self.problem))

    def space(self, *, material: bool) -> Space:
        """What is sought: force and motion, with or without the material."""
        return Space([*self.force.parameters(), self.motion, *(self.material.parameters() if material else ())])

    def __call__(self) -> Terms:
        """The loss of the fields as they are, infinite where the simulation leaves its bounds."""
        forward, layout = self.problem.forward, self.problem.layout
        z = self.whole.index_copy(0, self.free, self.motion)
        material = self.material(self.x)
        force = self.force(self.x, self.frames) * self.allowed if self.follows else self._force_at
        _carry(self.problem, material, self.z)
        unknowns = layout.unpack(z.to(forward.device, forward.dtype), modes=forward.basis.shape[2])
        try:
            motion = forward.simulate(unknowns, material.young, material.poisson, force)
        except SimulationError as error:
            self.problem.objective.failures.append(str(error))
            return Terms(z, None, torch.tensor(float("inf")))
        terms = self.problem.objective.terms(z, motion)
        assert motion.field_force is not None
        extra = self._prior(material, motion.field_force / layout.force_unit).double().cpu()
        terms.parts["fields"] = float(extra.detach())
        terms.total = terms.total + extra
        return terms

    def _force_at(self, x: torch.Tensor, frame: int) -> torch.Tensor:
        """Where the particles are at the start of a frame (paper Eq. 9)."""
        return self.force(x, self.frames[frame : frame + 1])[0] * self.allowed[frame]

    def _prior(self, material: Material, force: torch.Tensor) -> torch.Tensor:
        """What `Prior` asks of constants and vectors, of fields: near the search's answer, small and smooth."""
        fit = self.problem.settings.fit
        away = (material.young / self.start.young).log().square() @ self.tightness
        ratio = ((material.poisson - self.start.poisson) / POISSON_SD).square().mean()
        size = FORCE * force.square().sum(-1).mean() + fit.force_smoothness * self.smoothness(force)
        return 0.5 * (Prior.LOG_YOUNG * (away + ratio) + len(force) * size)


def train(
    problem: Problem, state: Iterate, *, clock: Clock | None = None, checkpoint: Checkpoint | None = None, stored: Stored | None = None
) -> Generator[Progress, None, Trained]:
    """Fields from the search's answer; ends after fit.field_iterations, or by the clock. Goes on from where `stored` says that training
    was."""
    clock = clock or Clock()
    model, fit = FieldModel(problem, state.z), problem.settings.fit
    done, checkpoint = stored.training if stored else None, checkpoint or Checkpoint(None)
    history = list(done.history) if done else []
    words, before = f"{fit.material_field} material, {fit.force_field} force", clock.spent_s
    try:
        for material, descent in _steps(model, fit, done):
            history.append(descent.value)
            checkpoint.offer(Stored(state, problem.forward.captured, Training(material, descent, tuple(history))))
            took, before = clock.spent_s - before, clock.spent_s
            yield Progress("fields", len(history) - 1, fit.field_iterations, descent.value, took * (fit.field_iterations - len(history)), words)
            if len(history) < fit.field_iterations and not clock.allows_fit(2 * took):
                clock.stopped = f"stopped by the time budget of {clock.limit_s:.0f} s after {len(history)} of {fit.field_iterations} iterations of the fields"
                break
    finally:
        checkpoint.flush()
    return _trained(model, history)


def _steps(model: FieldModel, fit: Fit, done: Training | None) -> Iterator[tuple[bool, Descent]]:
    """Steps with the material at rest, then with it, from where training was; whether the material moves, and the state."""
    warm_up = 0 if fit.force_field == "frame" else round(WARM_UP * fit.field_iterations)
    count, past = (len(done.history), done.material) if done else (0, False)
    for material, until in ((False, warm_up), (True, fit.field_iterations)):
        if past and not material:
            continue
        space = model.space(material=material)
        here = done.descent if done and done.material == material else None
        if here is not None:
            space.assign(here.at)
        for descent in islice(descend(space, lambda: model().total, here), max(until - count, 0)):  # none is begun that is not wanted
            count += 1
            yield material, descent


def _trained(model: FieldModel, history: list[float]) -> Trained:
    with torch.no_grad():
        terms = model()
        return Trained(terms, _summary(model, terms, history))


def _base(problem: Problem, z: np.ndarray) -> Believed:
    """The search's moduli on the particles; inside a part the prior's pattern, where there is one that varies there."""
    p, prepared = problem.disc.particles, problem.prepared
    young, poisson = problem.layout.young_of(z)[p.part - 1], p.poisson
    if prepared.prior is not None:
        pattern, _ = on_points(prepared.prior, prepared.body, prepared.clip.camera, p.x_rest)
        log_pattern = np.log(pattern)
        volume = np.bincount(p.part, p.volume)
        mean = np.bincount(p.part, p.volume * log_pattern) / np.maximum(volume, 1e-300)
        young = young * np.exp(np.clip(log_pattern - mean[p.part], -np.log(SPAN), np.log(SPAN)))
    return Believed(p.x_rest, young, poisson)


def _bounds(problem: Problem, base: Believed) -> Bounds:
    """SPAN about the moduli, no higher than fit.max_substeps carry."""
    young, carried = base.young, problem.forward.simulator.max_young(problem.settings.fit.max_substeps)
    return Bounds(float(young.min()) / SPAN, max(min(float(young.max()) * SPAN, carried), 1.001 * float(young.max())), log=True)


def _passed(problem: Problem) -> np.ndarray:
    """Points (K, 3) [m] that bound where the body was seen to go: at rest, and moved as far as any track to every side."""
    x, reach = problem.disc.particles.x_rest, reach_of(problem.prepared)
    return np.concatenate([x - reach, x + reach])


def _allowed(problem: Problem) -> np.ndarray:
    """1 in the frames (T - 1,) that may carry a force, 0 in those that are known to be free."""
    return np.isin(np.arange(len(problem.prepared.clip) - 1), problem.layout.forced).astype(float)


def _tightness(problem: Problem) -> np.ndarray:
    """Weights (P,) of squared log E: each part's mean, over its prior variance. Without zones the start values' own spread holds
    only if the part is one material, which is what a field doubts."""
    p, start = problem.disc.particles, problem.prepared.start
    doubt = VARIATION_SD if problem.prepared.zones is None else 0.0
    variance = np.log(10) ** 2 * (start.log10_young_sd[p.part - 1] ** 2 + doubt**2)
    return 1 / (variance * np.bincount(p.part)[p.part])


def _carry(problem: Problem, material: Material, z: np.ndarray) -> None:
    """Lay out the substeps anew where the fastest wave of the field has passed what they carry."""
    p = problem.disc.particles
    young, poisson = (value.detach().double().cpu().numpy() for value in material)
    as_stiff = young * (wave_speed(1.0, poisson, 1.0) / wave_speed(1.0, p.poisson, 1.0)) ** 2
    least = problem.layout.young_of(z)
    problem.forward.ensure_substeps(np.array([as_stiff[p.part == k + 1].max(initial=e) for k, e in enumerate(least)]))


def _summary(model: FieldModel, terms: Terms, history: list[float]) -> dict[str, Any]:
    p, own, zones = model.problem.disc.particles, model.problem.disc.particles.own, model.problem.prepared.zones
    part = (p.part if zones is None else zones.part[p.part - 1])[own]
    ratio = (model.material(model.x).young / model.start.young).log10().double().cpu().numpy()
    acted = None if terms.motion is None else terms.motion.field_force
    force = np.full((1, len(own)), np.nan) if acted is None else acted[:, own].norm(dim=-1).double().cpu().numpy()
    return {
        "material_field": model.words["material"],
        "force_field": model.words["force"],
        "force_frame": "rest" if model.follows else "current",
        "loss_history": history,
        "log10_young_change_per_part": [float(ratio[own][part == k].mean()) for k in np.unique(part)],
        "log10_young_change_spread": float(ratio[own].std()),
        "field_force_rms_n_m3": float(np.sqrt((force**2).mean())),
    }
