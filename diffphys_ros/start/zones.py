"""Young's modulus along a body whose materials nobody has outlined: a modulus per zone, from the tracks and the eigenmodes.

Where a mode bends how much says how stiff the body is there: its bending moment follows from the inertia of what lies further
out, its curvature is seen. So a few modes tell a whole profile, without any simulation. Neighbouring zones are held together by
a Cauchy prior (Markkanen, Roininen, Huttunen and Lasanen 2019, Cauchy difference priors for edge-preserving Bayesian inversion):
most borders are none, and a real one may be a jump of any size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from ..config import Settings
from ..differences import differences
from ..footprints import Footprint
from ..linear_systems import inverted
from ..modes.model import ModalModel
from ..types import Body, Camera, StartValues, Tracks
from ..vibration.coordinates import observe
from ..vibration.forced_frames import Support, find_support
from .evidence import Evidence
from .force import ForceProblem
from .free_tail import DETUNED, RATIO_SD, Physics, Tail, physical
from .place import best_footprint
from .stages import SETTLED, Fit
from .uncertainty import outline_sd
from .values import ALARM_NOISE, GUESS_SD, WIDEST_SD, values_of
from .zone_layout import HIDDEN_SD, Division

if TYPE_CHECKING:
    from ..elements.assemble import Elements

# the search begins where a gradual change and a jump hardly differ, and ends at the last
LEVELS = (0.4, 0.2, 0.1)  # scales of the Cauchy prior on differences of log E between neighbours in one part [chosen]
CONTRAST_SD = 0.75 * np.log(10.0)  # of log E of a zone about the mean of all [chosen]
GRADUAL = 0.5  # standard deviation of the difference of log E between neighbours where stiffness changes all along [chosen]
SLOPES = (1.0, 0.1, 0.3, 3.0)  # E at the farthest end over that at the clamp, at which the search begins [numerical]
DENSITY_SD = 0.15  # of ln(density) of a zone within a part when no density was given [chosen]
FARTHEST = np.log(8.0)  # of a search between two bases: the modes of a basis hold near it alone [numerical]
MODES, VARIED = 8, 3  # of the basis; whose change with every zone's modulus it spans [numerical]
ROUNDS, STEPS = 4, 6  # most times that the basis moves to the fit at the last scale; most steps of a search between [numerical]


@dataclass(frozen=True)
class Zoned:
    """A body whose parts are zones, with what the tracks say of them (K zones)."""

    body: Body
    start: StartValues
    modal: ModalModel
    part: np.ndarray  # 1..n of the undivided body that each zone lies in, (K,)
    log_young_precision: np.ndarray  # inverse covariance of log E, (K, K)


def zone_values(
    body: Body,
    tracks: Tracks,
    period_s: float,
    settings: Settings,
    start: StartValues,
    *,
    camera: Camera | None = None,
    pattern: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Zoned:
    """A modulus per zone, from the free tail and then from all frames with the force solved for inside.

    Args:
        body, tracks, period_s, settings, camera: as for start_values.
        start: values per part, with a free tail: where the search begins.
        pattern: what is believed of E [Pa, any scale] at body points (M, 3); inside a part zones are held to it instead of to
            each other's value.
    """
    from ..elements.assemble import Elements

    division = Division.of(body)
    zoned = division.divide(body)
    motion = observe(body, tracks, camera)
    support = find_support(motion.coordinates, motion.known, period_s, at_rest=settings.scene.at_rest, noise_m=motion.noise_m)
    evidence = Evidence(zoned, tracks, motion, period_s, settings)
    fit = _ZoneFit(evidence, Elements.of(zoned), support, division, _believed(zoned, division, pattern))
    physics = fit.first(Physics(start.young[division.part - 1], start.damping, np.zeros(DETUNED)))
    physics, modal = fit.settled(physics, fit.tail_misfit, levels=LEVELS)
    edges = fit.whole(modal).edges(physics)
    if any(edges):
        fit = replace(fit, support=support.grown(*edges))
        physics, modal = fit.settled(physics, fit.tail_misfit)
    footprint = best_footprint(fit.whole(modal), physics)
    physics, modal = fit.settled(physics, lambda modal: fit.whole_misfit(modal, footprint))
    misfit = fit.whole_misfit(modal, footprint)
    excess = misfit.excess(physics)
    variance, precision = fit.told(misfit, physics)
    sd = np.sqrt(variance + _outside_variance(body, tracks, division, settings)) / np.log(10)
    sd = sd if excess < ALARM_NOISE**2 else np.hypot(sd, GUESS_SD)
    tuned = Fit(evidence, modal, fit.support, physics, footprint).tuned
    values = values_of(tuned, density_contrast=DENSITY_SD)
    return Zoned(zoned, _told(values, sd, excess), tuned.modal, division.part, precision)


@dataclass(frozen=True)
class _Misfit:
    """Of the motion in some frames under given physics."""

    of: Callable[[Physics], np.ndarray]  # over what a frame may miss
    slope: Callable[[Physics], np.ndarray]  # its derivatives by the entries of Physics.vector()
    frames: int

    def excess(self, physics: Physics) -> float:
        """Mean square over what was expected, at least 1: linear modes do not follow large swings."""
        missed = self.of(physics)
        return max(float(missed @ missed) / self.frames, 1.0)


@dataclass(frozen=True)
class _ZoneFit:
    evidence: Evidence
    elements: Elements
    support: Support
    division: Division
    believed: np.ndarray  # log E that differences are measured from, (K,)

    def first(self, physics: Physics) -> Physics:
        """The best of a few slopes of stiffness along the body, each matched to the observed frequency and fitted a little: from
        one constant the modes may be taken for each other."""
        found = []
        for slope in SLOPES:
            tail = self.tail(self.basis(physics.young * slope**self.division.away))
            young = tail.matched(tail.modal.reference, float(self.support.frequencies_hz[0]))
            found.append(self._search(replace(physics, young=young), self.tail_misfit(tail.modal), LEVELS[0]))
        return min(found, key=lambda pair: pair[0])[1]

    def settled(
        self, physics: Physics, misfit_of: Callable[[ModalModel], _Misfit], *, levels: tuple[float, ...] = LEVELS[-1:]
    ) -> tuple[Physics, ModalModel]:
        """The minimum of a misfit and the priors, at one Cauchy scale after the other; the basis moves to the fit until it rests."""
        for level in (*levels, *levels[-1:] * ROUNDS):
            before, modal = physics.young, self.basis(physics.young)
            physics = self._search(physics, misfit_of(modal), level)[1]
            if level == levels[-1] and np.abs(np.log(physics.young / before)).max() < SETTLED:
                break
        return physics, modal

    def basis(self, young: np.ndarray) -> ModalModel:
        """Ritz model about moduli (K,) that follows their changes, zone by zone, to first order in the shapes."""
        from ..elements.assemble import modal_model

        return modal_model(self.elements, [young], [MODES], varied=VARIED)

    def tail(self, modal: ModalModel) -> Tail:
        """The problem of the free frames."""
        return self.evidence.tail(modal, self.support)

    def whole(self, modal: ModalModel) -> ForceProblem:
        """The problem of all frames."""
        return self.evidence.whole(modal, self.support)

    def tail_misfit(self, modal: ModalModel) -> _Misfit:
        """Of the free tail."""
        tail = self.tail(modal)
        return _Misfit(lambda physics: tail.misfit(physics).ravel() / tail.sigma_m, tail.slope, max(len(tail.data), 1))

    def whole_misfit(self, modal: ModalModel, footprint: Footprint) -> _Misfit:
        """Of all frames under the best force of a family."""
        problem = self.whole(modal)
        load = problem.footprint_load(footprint)

        def missed(physics: Physics) -> np.ndarray:
            return problem.solve(physics, load).residual

        def slope(physics: Physics) -> np.ndarray:
            vector, count = physics.vector(), len(physics.young)
            return differences(lambda v: missed(Physics.of(v, count)), vector, least=physical(len(vector), count))

        return _Misfit(missed, slope, int(problem.known.sum()))

    def prior(self, vector: np.ndarray, inside: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Residuals of the priors: differences between neighbours, by `inside` where they lie in one part; contrast; damping and
        detuning."""
        count, (a, b) = self.division.count, self.division.neighbours.T
        log_young = vector[:count] - self.believed
        difference, same = log_young[b] - log_young[a], self.division.part[a] == self.division.part[b]
        contrast = (log_young - log_young.mean()) / CONTRAST_SD
        return np.r_[np.where(same, inside(difference), difference / RATIO_SD), contrast, vector[count:]]

    def _search(self, physics: Physics, misfit: _Misfit, level: float) -> tuple[float, Physics]:
        """Cost and physics a few steps on."""

        def prior(vector: np.ndarray) -> np.ndarray:
            return self.prior(vector, lambda difference: cauchy(difference, level))

        def residual(vector: np.ndarray) -> np.ndarray:
            return np.r_[misfit.of(Physics.of(vector, count)), prior(vector)]

        def slope(vector: np.ndarray) -> np.ndarray:
            return np.concatenate([misfit.slope(Physics.of(vector, count)), differences(prior, vector)])

        count, (low, high) = self.division.count, physics.bounds()
        reach = np.r_[np.full(count, FARTHEST), np.full(len(low) - count, np.inf)]
        low, high = np.maximum(low, physics.vector() - reach), np.minimum(high, physics.vector() + reach)
        inside = np.clip(physics.vector(), low + 1e-9, high - 1e-9)
        found = least_squares(residual, inside, bounds=(low, high), jac=slope, max_nfev=STEPS, ftol=1e-4)
        return float(found.cost), Physics.of(found.x, count)

    def told(self, misfit: _Misfit, physics: Physics) -> tuple[np.ndarray, np.ndarray]:
        """Variance (K,) and inverse covariance (K, K) of log E by Gauss-Newton, damping and detuning left open. The inverse
        covariance is that under the Cauchy prior; the variance allows that stiffness changes gradually all along, or that any
        one border is one of materials unseen."""
        vector, count = physics.vector(), self.division.count
        slope = misfit.slope(physics)
        data = slope.T @ slope / misfit.excess(physics)

        def covariance(inside: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
            prior = differences(lambda v: self.prior(v, inside), vector)
            return inverted(data + prior.T @ prior)[:count, :count]

        likely = covariance(partial(_loosened, border=-1))
        unseen = [covariance(partial(_loosened, border=k)) for k in range(len(self.division.neighbours))]
        gradual = covariance(lambda difference: difference / GRADUAL)
        return np.max([np.diag(c) for c in (likely, gradual, *unseen)], axis=0), inverted(likely)


def _loosened(difference: np.ndarray, border: int) -> np.ndarray:
    """The Cauchy prior at the scale of the end, but one border (-1: none) as if two materials met there."""
    return np.where(np.arange(len(difference)) == border, difference / HIDDEN_SD, cauchy(difference, LEVELS[-1]))


def cauchy(difference: np.ndarray, scale: float) -> np.ndarray:
    """Residuals whose half squares are, up to a constant, the negative logarithm of a Cauchy density."""
    return np.sign(difference) * np.sqrt(2 * np.log1p((difference / scale) ** 2))


def _believed(zoned: Body, division: Division, pattern: Callable[[np.ndarray], np.ndarray] | None) -> np.ndarray:
    """Mean over each zone's volume of the logarithm of what is believed, (K,); zeros where nothing is."""
    if pattern is None:
        return np.zeros(division.count)
    front = zoned.front
    log_young = np.log(pattern(front.points))
    zone = division.zone[zoned.cell_of(front.points)].astype(int) - 1
    return np.bincount(zone, front.volume * log_young, division.count) / np.maximum(np.bincount(zone, front.volume, division.count), 1e-300)


def _outside_variance(body: Body, tracks: Tracks, division: Division, settings: Settings) -> np.ndarray:
    """Variance of log E per zone (K,) from what no misfit shows: the outline, and densities where a person gave none per part
    (only E over density is seen)."""
    density = 0.0 if settings.scene.density_kg_m3 is not None else DENSITY_SD
    return outline_sd(body, tracks)[division.part - 1] ** 2 + density**2


def _told(values: StartValues, sd: np.ndarray, excess: float) -> StartValues:
    missed = f"; the motion is missed by {np.sqrt(excess):.0f} times what was expected" if excess >= ALARM_NOISE**2 else ""
    reasons = tuple(f"a zone of a field; log10 E is known to +-{s:.2f}{missed}." for s in sd)
    return replace(values, log10_young_sd=sd, identified=sd <= WIDEST_SD, reasons=reasons)
