"""Start values: from tracks and the filled body to Young's moduli, damping and force, without any simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..config import Settings
from ..footprints import Footprint
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.coordinates import Motion, Projection, observe
from ..vibration.forced_frames import Support, find_support
from .force import ForceProblem, Solution
from .free_tail import FREQUENCY_SD, MODEL_ERROR, Physics, Tail
from .uncertainty import detuning_log10_sd, geometry_log10_sd, log10_young_sd

if TYPE_CHECKING:
    from ..elements.assemble import Elements

UNIT_YOUNG = 1e5  # [Pa]; any would do for a linear solid without weight
WIDE_RATIOS, NARROW_RATIOS = (0.1, 0.35, 3.0), (0.7, 1.4)  # between parts, at which the Ritz basis is exact
RIGID = 1e-9  # squared frequencies below this share of the largest are rigid motions
BASES = 3  # most times that the basis is moved to the fit
SETTLED = 0.1  # change of log E that needs no new basis
NARROW_MODES = 6  # per further point of the basis
ALARM_NOISE, ALARM_SHARE = 5.0, 0.12  # misfit over the coherent noise and over the motion that together ask for an alarm
MOST_DETUNING = 5.0  # times what errors of the outline allow: then the body is not the one that was told, and E means nothing
WIDEST_SD = 0.15  # of log10 E that still counts as identified
STILL = 4.0  # motion over noise below which nothing can be said
GUESS_SD = 0.5  # of log10 E of a guess
STIFFENINGS = 20  # doublings, at most, of a modulus that buckles
PRIOR_DAMPING = 1e-3  # stiffness damping of a guess [s]


class Belief(Protocol):
    """What is believed of Young's modulus before any motion is looked at."""

    @property
    def young(self) -> np.ndarray:
        """Per part [Pa], (n,)."""
        ...

    @property
    def log10_young_sd(self) -> np.ndarray:
        """Per part, (n,)."""
        ...


def start_values(
    body: Body,
    tracks: Tracks,
    period_s: float,
    settings: Settings,
    *,
    camera: Camera | None = None,
    belief: Belief | None = None,
    guess_scale: float = 1.0,
) -> tuple[StartValues, ModalModel]:
    """Young's modulus per part and damping from the free tail, force from all frames, and the modes they came from.

    Args:
        body: filled solid.
        tracks: surface points.
        period_s: time between frames [s].
        settings: `scene.at_rest` and `experiment.mode_count`.
        camera: for the lines of sight, where the tracks have no depth.
        belief: Young's moduli to take where there is no free tail; without it a guess from the clip's strongest frequency.
        guess_scale: factor on the first guess of Young's modulus, which the search must forget.
    """
    from ..elements.assemble import Elements

    motion = observe(body, tracks, camera)
    support = find_support(motion.coordinates, motion.known, period_s, at_rest=settings.scene.at_rest, noise_m=motion.noise_m)
    if motion.size_m < STILL * motion.noise_m:
        support = replace(support, has_free_tail=False)
    fit = Evidence(Elements.of(body), body, tracks, motion, support, period_s, settings, belief, guess_scale)
    if support.has_free_tail:
        fit, physics, modal = fit.settled()
    else:
        physics, modal = fit.guess()
    problem = fit.force_problem(modal)
    footprint = problem.best_footprint(physics)
    if support.has_free_tail:
        physics = problem.refine(physics, problem.footprint_load(footprint))
    modal = modal.retuned(physics.young, physics.detune).rotated(physics.young)
    return fit.values(physics, modal, footprint), modal


@dataclass(frozen=True)
class Evidence:
    """What start values are read from."""

    elements: Elements
    body: Body
    tracks: Tracks
    motion: Motion
    support: Support
    period_s: float
    settings: Settings
    belief: Belief | None
    guess_scale: float = 1.0

    def settled(self) -> tuple[Evidence, Physics, ModalModel]:
        """Tail fit, the support grown by what the fit shows, and the tail fitted again where it grew."""
        physics, modal = self.physics()
        edges = self.force_problem(modal).edges(physics)
        if not any(edges):
            return self, physics, modal
        fit = replace(self, support=self.support.grown(*edges))
        return fit, fit.tail(modal).search(physics)[1], modal

    def physics(self) -> tuple[Physics, ModalModel]:
        """Tail fit, with the basis moved to where the fit lies until it rests."""
        hz, decay = self.support.frequencies_hz[0], self.support.decay_per_s[0]
        unit = np.full(self.body.parts, UNIT_YOUNG)
        modal = self._basis(unit, WIDE_RATIOS, loaded=False)
        guess = _swinging_at(modal, unit, hz) * self.guess_scale
        physics = self.tail(modal).fit(guess, hz, decay)
        for _ in range(BASES):
            before = physics.young
            modal = self._basis(before, NARROW_RATIOS)
            physics = self.tail(modal).search(physics)[1]
            if np.abs(np.log(physics.young / before)).max() < SETTLED:
                break
        return physics, modal

    def guess(self) -> tuple[Physics, ModalModel]:
        """The moduli believed in; without any, one for all parts at which the lowest mode swings at the clip's strongest frequency."""
        if self.belief is not None:
            return self._standing(self.belief.young * self.guess_scale)
        hz = _strongest_hz(self.motion.coordinates[:, 0], self.period_s)
        unit = np.full(self.body.parts, UNIT_YOUNG)
        young = _swinging_at(self._basis(unit, (), loaded=False), unit, hz) * self.guess_scale
        return Physics(young, 0.0, PRIOR_DAMPING, np.zeros(0)), self._basis(young, NARROW_RATIOS)

    def _standing(self, young: np.ndarray) -> tuple[Physics, ModalModel]:
        """`young`, made stiffer as far as the body needs it in order not to buckle under its weight."""
        modal = self._basis(young, NARROW_RATIOS)
        for _ in range(STIFFENINGS):
            if modal.eigen(young)[0][0] > 0:
                break
            young = 2.0 * young
            modal = self._basis(young, NARROW_RATIOS)
        return Physics(young, 0.0, PRIOR_DAMPING, np.zeros(0)), modal

    def _basis(self, young: np.ndarray, ratios: tuple[float, ...], *, loaded: bool = True) -> ModalModel:
        from ..elements.assemble import modal_model

        count = self.settings.experiment.mode_count
        outer = [np.where(np.arange(len(young)) == i, r, 1.0) for i in range(1, len(young)) for r in ratios]
        counts = [count] + [min(count, NARROW_MODES)] * len(outer)
        return modal_model(self.elements, [young, *(young * o for o in outer)], counts, loaded=loaded)

    def tail(self, modal: ModalModel) -> Tail:
        """The tail's misfit under a modal model."""
        first = self.support.tail_start
        seen = Projection.of(self.motion, modal)
        moved = seen.data[first:] if first < len(seen.data) else seen.data  # none at all where the force acts to the end
        sigma = float(np.hypot(self.motion.coherent_m, MODEL_ERROR * np.sqrt((moved**2).sum(1).mean())))
        at_rest = self.settings.scene.at_rest
        return Tail(modal, seen, first, self.period_s, self.motion.known, at_rest, sigma, self.settings.experiment.mode_count)

    def force_problem(self, modal: ModalModel) -> ForceProblem:
        """The misfit of all frames under a modal model and a force."""
        q, known = self.motion.coordinates, self.motion.known
        sigma = float(np.hypot(self.motion.coherent_m, MODEL_ERROR * self.motion.size_m))
        acceleration = np.sqrt((np.diff(q, 2, axis=0) ** 2).sum(1).mean()) / self.period_s**2
        unit = max(float(acceleration), 1e-6) * self.body.mass_kg / self.body.volume_m3
        allowed = self.support.allowed if self.support.has_free_tail else np.ones(len(q), bool)
        seen = Projection.of(self.motion, modal)
        largest = self.motion.size_m / max(float(np.linalg.norm(seen.operator[:, 0])), 1e-12)
        return ForceProblem(modal, seen, self.period_s, known, allowed, self.settings.scene.at_rest, sigma, unit, largest)

    def values(self, physics: Physics, modal: ModalModel, footprint: Footprint) -> StartValues:
        """Force, spread and words for given physics; modal is tuned to them."""
        detuning = float(np.abs(physics.detune).max(initial=0.0))
        physics = replace(physics, detune=np.zeros_like(physics.detune))
        tail, support, problem = self.tail(modal), self.support, self.force_problem(modal)
        load = problem.footprint_load(footprint)
        solution = problem.solve(physics, load)
        residual = float(np.sqrt((tail.misfit(physics) ** 2).sum(1).mean())) if len(tail.data) else 0.0
        free = support.has_free_tail
        geometry_sd = geometry_log10_sd(tail, self.body, self.tracks, density_known=self.settings.scene.density_kg_m3 is not None)
        sd = np.hypot(log10_young_sd(tail, physics, geometry_sd), detuning_log10_sd(detuning)) if free else self._sd_of_guess()
        holds = not (free and explained_badly(residual, self.motion.coherent_m, tail.size_m))
        reasons = self._reasons(sd, residual, tail.size_m if free else 0.0, detuning, holds=holds)
        return StartValues(
            young=physics.young,
            log10_young_sd=sd,
            mass_damping=physics.mass_damping,
            stiffness_damping=physics.stiffness_damping,
            forced=problem.allowed,
            footprint=footprint,
            force=solution.force,
            initial_displacement=solution.initial_displacement,
            initial_velocity=solution.initial_velocity,
            frequencies_hz=problem.modal.frequencies(physics.young),
            observed_hz=support.frequencies_hz,
            decay_per_s=support.decay_per_s,
            track_cost=self._track_cost(problem, physics, solution, load),
            identified=np.array([not r[0] for r in reasons]),
            reasons=tuple(r[1] for r in reasons),
            has_free_tail=free,
            modes_hold=holds,
            geometry_sd=geometry_sd,
            detuning=detuning,
        )

    def _sd_of_guess(self) -> np.ndarray:
        return np.full(self.body.parts, GUESS_SD) if self.belief is None else self.belief.log10_young_sd

    def _track_cost(self, problem: ForceProblem, physics: Physics, solution: Solution, load: np.ndarray) -> float:
        """Mean squared misfit of the linear motion on the raw tracks over their mean squared motion."""
        q = problem.modal.respond(
            physics.young,
            mass_damping=physics.mass_damping,
            stiffness_damping=physics.stiffness_damping,
            load=solution.force @ load.T,
            period_s=self.period_s,
            initial_displacement=solution.initial_displacement,
            initial_velocity=solution.initial_velocity,
        )
        return self.motion.misfit_share(problem.modal, q - q[:1])

    def _reasons(self, sd: np.ndarray, residual: float, size: float, detuning: float, *, holds: bool) -> list[tuple[bool, str]]:
        """Per part whether it is not identified, and a sentence."""
        if not self.support.has_free_tail:
            moved = self.motion.size_m >= STILL * self.motion.noise_m
            why = "the clip shows no free oscillation of sufficient length" if moved else "the object hardly moves"
            source = "a guess" if self.belief is None else "the material prior's"
            return [(True, f"{why}, so this Young's modulus is {source}; record a longer tail without force.")] * len(sd)
        if not holds:
            text = f"the free motion differs from the fitted modes by {1e3 * residual:.2f} mm of {1e3 * size:.2f} mm; check mask, thickness and parts."
            return [(True, text)] * len(sd)
        if detuning > MOST_DETUNING * FREQUENCY_SD:
            text = (
                f"the modes explain the free motion only if a frequency of theirs is {100 * detuning:.0f} % off, at most {100 * MOST_DETUNING * FREQUENCY_SD:.0f} % "
                "is allowed; check scene.gravity_m_s2, thickness, mask and parts."
            )
            return [(True, text)] * len(sd)
        return [
            (True, f"log10 E is known to +-{s:.2f} only: this part hardly strains in the free motion.")
            if s > WIDEST_SD
            else (False, f"fitted to the free motion within {1e3 * residual:.2f} mm of {1e3 * size:.2f} mm.")
            for s in sd
        ]


def explained_badly(residual_m: float, noise_m: float, size_m: float) -> bool:
    """Whether a model misses so much of a motion of that size that its stiffness cannot be believed."""
    return residual_m > ALARM_NOISE * noise_m and residual_m > ALARM_SHARE * size_m


def _swinging_at(modal: ModalModel, young: np.ndarray, hz: float) -> np.ndarray:
    """`young` times the factor that moves the lowest elastic mode to a frequency, gravity left out."""
    squares = np.linalg.eigvalsh(modal.matrix(young) - modal.geometric)
    return young * (2 * np.pi * hz) ** 2 / squares[squares > RIGID * squares[-1]][0]


def _strongest_hz(q: np.ndarray, period_s: float) -> float:
    """Frequency of the largest peak of the spectrum, at least one swing per clip."""
    power = np.abs(np.fft.rfft(q - q.mean(), 8 * len(q))) ** 2
    hz = np.fft.rfftfreq(8 * len(q), period_s)
    floor = 1.0 / (len(q) * period_s)
    return float(max(hz[np.where(hz < floor, 0.0, power).argmax()], floor))
