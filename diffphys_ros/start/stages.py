"""The first answer as lists of stages. Each says which evidence counts and what is free; all else stays as the stage before left it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from ..damping import Damping
from ..footprints import Footprint
from ..modes.model import ModalModel
from ..vibration.forced_frames import LEAST_TAIL_FRAMES, Support, bridged, least_tail_frames
from .evidence import Evidence
from .expected import expecting
from .force import ForceProblem, nothing
from .free_tail import Physics, Tail
from .place import best_footprint

if TYPE_CHECKING:
    from ..elements.assemble import Elements

UNIT_YOUNG = 1e5  # [Pa]; any would do for a linear solid without weight [numerical]
WIDE_RATIOS, NARROW_RATIOS = (0.1, 0.35, 3.0), (0.7, 1.4)  # between parts, at which the Ritz basis is exact [numerical]
RIGID = 1e-9  # squared frequencies below this share of the largest are rigid motions [numerical]
BASES = 3  # most times that the basis is moved to the fit [numerical]
SETTLED = 0.1  # change of log E and log density that needs no new basis [numerical]
STIFFENINGS = 20  # doublings, at most, of a modulus that buckles [numerical]
PRIOR_DAMPING = Damping(0.0, 1e-3)  # of a guess [chosen]
SPARSITY = (1e3, 3e2, 1e2, 3e1)  # of the force in time, round by round; the last on the frames that are kept [chosen]
ROUNDING = 0.02  # of the corner of the sparse prior, in units of the accelerations seen [numerical]
MISSED = 5.0  # times what a frame of the tail may miss, from which on a force is looked for inside it [chosen]
LATER, TAILS = 2, 8  # frames by which the tail is begun later, at the least, and how often [numerical]
EXPLAINED = 0.5  # of what was missed: at most so much is left where a later tail is free of a force that the first was not [chosen]
NEAR_BEST = 1.5  # times the least missed: the longest tail that misses no more is taken [chosen]
ACTIVE = 0.15  # share of the largest force above which a frame counts as forced [chosen]


@dataclass(frozen=True)
class Fit:
    """How far the first answer has come: the unknowns, and what they are read from."""

    evidence: Evidence
    modal: ModalModel
    support: Support  # frames that may carry a force
    physics: Physics
    footprint: Footprint = field(default_factory=Footprint)
    force: np.ndarray | None = None  # amplitude [N/m^3], (T, 3); None: none was fitted yet
    heaviness: np.ndarray | None = None  # of the prior on the size of each frame's force (see ForceProblem), (T,)
    rivals_sd: np.ndarray | float = 0.0  # of log10 E by other valleys that explain the tail nearly as well, (n,)
    grown: bool = False  # whether the forced frames are more than those that physics were read from

    @classmethod
    def begun(cls, evidence: Evidence, elements: Elements, support: Support) -> Fit:
        """A body of UNIT_YOUNG, before anything is looked at."""
        unit = np.full(evidence.body.parts, UNIT_YOUNG)
        modal = evidence.basis(elements, unit, WIDE_RATIOS if support.has_free_tail else (), loaded=False)
        return cls(evidence, modal, support, guessed(unit))

    @property
    def tuned(self) -> Fit:
        """The same with the materials and the frequencies that were found in body and modal model, which has the eigenmodes as basis."""
        physics, body, modal = self.physics, self.evidence.body, self.modal
        if physics.density is not None:
            body, modal = replace(body, density=physics.density), modal.weighing(physics.density)
        if physics.poisson is not None:
            body, modal = replace(body, poisson=physics.poisson), modal.squeezing(physics.poisson)
        modal = modal.retuned(physics.young, physics.detune, physics.coupling).rotated(physics.young)
        return replace(self, evidence=replace(self.evidence, body=body), modal=modal, physics=replace(physics, density=None, poisson=None))

    @property
    def tail(self) -> Tail:
        """The problem of the free frames."""
        return self.evidence.tail(self.modal, self.support)

    def at_tail(self, physics: Physics, rivals_sd: np.ndarray) -> Fit:
        """The same with what a search of the tail found."""
        return replace(self, physics=physics, rivals_sd=rivals_sd)

    @cached_property
    def whole(self) -> ForceProblem:
        """The problem of all frames."""
        problem = self.evidence.whole(self.modal, self.support)
        return problem if self.heaviness is None else replace(problem, heaviness=self.heaviness)

    @cached_property
    def acting(self) -> ForceProblem:
        """The same with what the tracks hold of second order left open or computed, where the clip begins at rest and a free tail tells the stiffness: a joint fit of
        stiffness and force is read without."""
        second = self.evidence.second_order(self.whole) if self.support.has_free_tail else None
        return self.whole if second is None else second

    def last(self, *, missed: float = 0.0) -> ForceProblem:
        """The same once physics and place are found, with what is expected along the body; arguments as for `expecting`."""
        return expecting(self.acting, self.physics, self.load, missed=missed)

    @property
    def load(self) -> np.ndarray:
        """Modal loads (r, 3) of the footprint."""
        return self.whole.footprint_load(self.footprint)


@dataclass(frozen=True)
class Stage:
    """One stage of a fit."""

    name: str
    evidence: str  # which counts: "free frames", "all frames" or "told"
    free: tuple[str, ...]  # fields of Fit
    step: Callable[[Fit], Fit]

    def __call__(self, fit: Fit) -> Fit:
        """What is free as the step leaves it, all else as it was."""
        found = self.step(fit)
        return replace(fit, **{name: getattr(found, name) for name in self.free})


def run(stages: Sequence[Stage], fit: Fit) -> Fit:
    """One after the other."""
    for stage in stages:
        fit = stage(fit)
    return fit


def modes(elements: Elements, guess_scale: float) -> list[Stage]:
    """Where a free tail tells the stiffness."""
    return [
        Stage("tail", "free frames", ("modal", "physics", "rivals_sd"), partial(_tail, elements=elements, guess_scale=guess_scale)),
        Stage("later tail", "free frames", ("support", "physics", "rivals_sd"), _later_tail),
        Stage("edges", "all frames", ("support", "grown"), _edges),
        Stage("tail again", "free frames", ("physics", "grown"), _tail_again),
        Stage("footprint", "all frames", ("footprint",), _footprint),
        Stage("refine", "all frames", ("physics",), _refine),
    ]


def guess(elements: Elements, guess_scale: float) -> list[Stage]:
    """Where none does: what is believed, or the clip's strongest frequency."""
    return [
        Stage("guess", "told", ("modal", "physics"), partial(_guess, elements=elements, guess_scale=guess_scale)),
        Stage("footprint", "all frames", ("footprint",), _footprint),
    ]


def joint() -> list[Stage]:
    """Stiffness, damping and force together: a force fitted first would explain the motion at any stiffness."""
    return [
        *(Stage("sparse force", "all frames and what is believed", ("heaviness", "physics", "force"), partial(_sparse, weight=w)) for w in SPARSITY[:-1]),
        Stage("forced frames", "all frames", ("support",), _kept),
        Stage("refine", "all frames and what is believed", ("heaviness", "physics", "force"), partial(_sparse, weight=SPARSITY[-1])),
    ]


def footprint_again() -> list[Stage]:
    """Where the force acts, by tracks of first order and nearly right physics."""
    return [Stage("footprint", "all frames", ("footprint",), _footprint)]


def physics_again() -> list[Stage]:
    """What follows from that for stiffness and damping."""
    return [Stage("refine", "all frames and what is believed", ("physics",), _refine)]


def _tail(fit: Fit, *, elements: Elements, guess_scale: float) -> Fit:
    """The free tail, with the basis moved to where the fit lies until it rests."""
    hz, decay = fit.support.frequencies_hz[0], fit.support.decay_per_s[0]
    young = swinging_at(fit.modal, fit.physics.young, hz) * guess_scale
    fit = fit.at_tail(*fit.tail.fit(young, hz, decay))
    for _ in range(BASES):
        before = fit.physics
        if before.density is not None:
            elements = elements.weighing(before.density)
        if before.poisson is not None:
            elements = elements.squeezing(before.poisson)
        fit = replace(fit, modal=fit.evidence.basis(elements, before.young, NARROW_RATIOS))
        fit = replace(fit, physics=fit.tail.search(before)[1])
        if fit.physics.change(before) < SETTLED:
            break
    return fit


def _later_tail(fit: Fit) -> Fit:
    """The longest tail that the modes explain, where they miss much of the first: noise and lost frames hide the last of several gusts from
    what reads forced frames from the motion alone, and a tail with a force in it tells nothing."""
    missed = fit.tail.missed_m(fit.physics)
    if missed <= MISSED * fit.tail.sigma_m:
        return fit
    hz, decay = fit.support.frequencies_hz[0], fit.support.decay_per_s[0]
    room = len(fit.whole.known) - least_tail_frames(hz, fit.evidence.period_s) - fit.support.tail_start

    @cache
    def begun(by: int) -> tuple[float, Fit]:
        """A tail that begins so many frames later, and the share of its motion that is missed."""
        trial = replace(fit, support=fit.support.grown(0, by))
        trial = trial.at_tail(*trial.tail.fit(fit.physics.young, hz, decay))
        return trial.tail.missed_m(trial.physics) / trial.tail.size_m, trial

    later = range(LATER, room + 1, max(LATER, math.ceil(room / TAILS)))
    by = first_explained(lambda by: begun(by)[0], later, EXPLAINED * missed / fit.tail.size_m)
    return fit if by is None else begun(by)[1]


def first_explained(missed: Callable[[int], float], places: Sequence[int], most: float) -> int | None:
    """The first of places (rising) at which little more is missed than at the best of them. None where more than `most` is missed both at the
    middle one and at the last, in which case no other is tried: each costs a fit."""
    if not places or min(missed(places[len(places) // 2]), missed(places[-1])) > most:
        return None
    best = min(missed(place) for place in places)
    return next(place for place in places if missed(place) <= NEAR_BEST * best)


def _edges(fit: Fit) -> Fit:
    """Forced frames that only the motion shows."""
    before, after = fit.whole.edges(fit.physics)
    spare = int(fit.whole.known[fit.support.tail_start :].sum()) - LEAST_TAIL_FRAMES  # a tail must be left, whatever the wrong physics of a wrong outline finds
    after = min(after, max(spare, 0))
    return replace(fit, support=fit.support.grown(before, after), grown=True) if before or after else fit


def _tail_again(fit: Fit) -> Fit:
    """The tail that is left where the forced frames grew."""
    return replace(fit, physics=fit.tail.search(fit.physics)[1], grown=False) if fit.grown else fit


def _footprint(fit: Fit) -> Fit:
    return replace(fit, footprint=best_footprint(fit.acting, fit.physics))


def _refine(fit: Fit) -> Fit:
    believed = fit.evidence.believed if fit.evidence.first_order else nothing
    return replace(fit, physics=fit.acting.refine(fit.physics, fit.load, believed=believed))


def _guess(fit: Fit, *, elements: Elements, guess_scale: float) -> Fit:
    """The moduli believed in; without any, one for all parts at which the lowest mode swings at the clip's strongest frequency."""
    evidence = fit.evidence
    if evidence.belief is not None:
        return _standing(fit, evidence.belief.young * guess_scale, elements)
    hz = strongest_hz(evidence.motion.coordinates[:, 0], evidence.period_s)
    young = swinging_at(fit.modal, fit.physics.young, hz) * guess_scale
    return replace(fit, modal=evidence.basis(elements, young, NARROW_RATIOS), physics=guessed(young))


def _standing(fit: Fit, young: np.ndarray, elements: Elements) -> Fit:
    """`young`, made stiffer as far as the body needs it in order not to buckle under its weight; what nothing holds falls, and does not."""
    modal = fit.evidence.basis(elements, young, NARROW_RATIOS)
    for _ in range(STIFFENINGS):
        if not fit.evidence.body.clamped or modal.eigen(young)[0][0] > 0:
            break
        young = 2.0 * young
        modal = fit.evidence.basis(elements, young, NARROW_RATIOS)
    return replace(fit, modal=modal, physics=guessed(young))


def guessed(young: np.ndarray) -> Physics:
    """Moduli (n,) [Pa] that were not fitted."""
    return Physics(young, PRIOR_DAMPING, np.zeros(0))


def _sparse(fit: Fit, *, weight: float) -> Fit:
    """A round of a force that is sparse in time: the weight of each frame's size comes from the force of the round before."""
    size = np.ones(len(fit.whole.known)) if fit.force is None else np.linalg.norm(fit.force @ fit.whole.stiff.costs, axis=1) / fit.whole.force_unit
    fit = replace(fit, heaviness=weight / np.hypot(size, ROUNDING))
    physics = fit.whole.refine(fit.physics, fit.load, believed=fit.evidence.believed)
    return replace(fit, physics=physics, force=fit.whole.solve(physics, fit.load).force)


def _kept(fit: Fit) -> Fit:
    assert fit.force is not None
    return replace(fit, support=replace(fit.support, forced=active(np.linalg.norm(fit.force, axis=1))))


def active(size: np.ndarray) -> np.ndarray:
    """Frames (T,) whose force is more than ACTIVE of the largest, short gaps bridged."""
    return bridged(size > ACTIVE * max(size.max(), 1e-12))


def swinging_at(modal: ModalModel, young: np.ndarray, hz: float) -> np.ndarray:
    """`young` times the factor that moves the lowest elastic mode to a frequency, gravity left out."""
    squares = np.linalg.eigvalsh(modal.matrix(young) - modal.geometric)
    return young * (2 * np.pi * hz) ** 2 / squares[squares > RIGID * squares[-1]][0]


def strongest_hz(q: np.ndarray, period_s: float) -> float:
    """Frequency of the largest peak of the spectrum, at least one swing per clip."""
    power = np.abs(np.fft.rfft(q - q.mean(), 8 * len(q))) ** 2
    hz = np.fft.rfftfreq(8 * len(q), period_s)
    floor = 1.0 / (len(q) * period_s)
    return float(max(hz[np.where(hz < floor, 0.0, power).argmax()], floor))
