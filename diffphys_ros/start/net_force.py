"""How surely the net force is known: the covariance of what is off about it, over all frames.

Four things are off, independent of each other: what the film and the modes miss of the motion, together with what the priors on the force took off; stiffness
and damping; densities that nobody told; and the place on the body where the force acts, over which the evidence is averaged, and what is open near it. All but the
first are taken by solving for the force again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..footprints import Footprint
from ..modes.model import ModalModel
from .along import beside
from .densities import DENSITY_CONTRAST
from .expected import across_squared, alike, missed_in_stiff_ways, shapes_in_stiff_ways, together, without_force
from .force import ForceProblem, Solution
from .free_tail import Physics
from .material_doubt import material_changes
from .place import before, between_tried, leading_frames, open_nearby, probabilities, unlikely
from .stages import Fit
from .uncertainty import Bend

MISSED_PERIODS = 0.1  # the same of what a frame misses, over the leading period: a quarter of one then counts once [derived: sqrt(2 pi) of it]
UNLIKELY = 1e-4  # probability of a place below which it is left out [numerical]
SMALL_N = 1e-300  # a force of nothing [numerical]
DRAWS = 200  # pairs of opposite draws, of the largest force [numerical]
FARTHEST = 0.3  # of ln E, or of the unit of another unknown, that a step of a difference may change [numerical]


@dataclass(frozen=True)
class NetForceDoubt:
    """What the net force of the forced frames may be in the place of the one found: that of a place on the body, and what is off about it whatever the place."""

    frames: np.ndarray  # that may carry a force, (F,)
    found: np.ndarray  # [N], body frame, (F, 3)
    elsewhere: np.ndarray  # found with other places of the force [N], (m, F, 3)
    probability: np.ndarray  # of these places, (m,)
    scatter: np.ndarray  # covariance of errors of the estimate, at any place [N^2], (3 F, 3 F)
    unseen: np.ndarray  # of what the truth has beyond it, which the motion does not tell

    @property
    def variance(self) -> np.ndarray:
        """Mean square of what is off about the force that was found, between components, (F, 3, 3) [N^2]."""
        change = self.elsewhere - self.found
        own = np.einsum("icid->icd", (self.scatter + self.unseen).reshape(2 * [len(self.frames), 3]))
        return own + np.einsum("m,mfc,mfd->fcd", self.probability, change, change)

    def peak(self, published: np.ndarray) -> tuple[float, float]:
        """The largest size of the net force [N] and its standard deviation, where (F, 3) is published in the place of `found`.

        Errors of the estimate make the largest of it too large, by the factor by which the same errors would make it larger again; what is not seen is not in it. Other places
        count in the deviation alone.
        """
        own = largest(published)
        by_error, by_unseen = (largest(published + self._drawn(each)) for each in (self.scatter, self.unseen))
        elsewhere = largest(published + self.elsewhere - self.found) - own
        mean = own * by_unseen.mean() / max(by_error.mean(), SMALL_N)
        return float(mean), float(np.sqrt(by_error.var() + by_unseen.var() + self.probability @ elsewhere**2))

    def _drawn(self, covariance: np.ndarray) -> np.ndarray:
        """Errors (2 DRAWS, F, 3) [N] of this covariance, in opposite pairs."""
        size, axes = np.linalg.eigh(covariance)
        draws = np.random.default_rng(0).standard_normal((DRAWS, len(size))) * np.sqrt(np.maximum(size, 0.0)) @ axes.T
        return np.concatenate([draws, -draws]).reshape(-1, *self.found.shape)


def largest(net: np.ndarray) -> np.ndarray:
    """Largest size over time of net forces (..., F, 3)."""
    return np.asarray(np.linalg.norm(net, axis=-1).max(-1))


def net_force_doubt(fit: Fit, log10_young_sd: np.ndarray, *, missed_m: float | None = None, density_contrast: float = DENSITY_CONTRAST) -> NetForceDoubt:
    """Of the force of a fit. Without a free tail E is off by `log10_young_sd` (n,), and nothing else is asked of the material. `missed_m`: what is missed of a
    frame [m] where the fit is to a motion without error."""
    doubt = _Doubt(fit, missed_m)
    changes = np.hstack([doubt.by_physics(log10_young_sd), doubt.by_material(density_contrast), doubt.by_moving_it()])
    scatter, unseen = doubt.missed()
    elsewhere, probability = doubt.by_place()
    shape = (-1, len(doubt.force) // 3, 3)
    return NetForceDoubt(
        np.flatnonzero(doubt.whole.allowed), doubt.force.reshape(shape[1:]), elsewhere.reshape(shape), probability, scatter + changes @ changes.T, unseen
    )


@dataclass(frozen=True)
class _Doubt:
    fit: Fit
    told_m: float | None  # what is missed of a frame; None: it is read from the fit

    @cached_property
    def whole(self) -> ForceProblem:
        return self.fit.last(missed=self.told_squared)

    @property
    def told_squared(self) -> float:
        """Square of what a frame is told to miss, over its sigma."""
        return ((self.told_m or 0.0) / self.fit.whole.sigma_m) ** 2

    @cached_property
    def solution(self) -> Solution:
        """Of the fit."""
        return self.whole.solve(self.fit.physics, self.load)

    @cached_property
    def load(self) -> np.ndarray:
        """Modal loads (r, 3) of the fit's footprint."""
        return self.whole.footprint_load(self.fit.footprint)

    @cached_property
    def force(self) -> np.ndarray:
        """Net force [N] of the allowed frames, (3 F,)."""
        return self._net(self.solution, self.fit.footprint)

    @cached_property
    def leading_frames(self) -> float:
        """Frames of a leading period."""
        return leading_frames(self.whole, self.fit.physics)

    def _net(self, solution: Solution, footprint: Footprint) -> np.ndarray:
        return solution.force[self.whole.allowed].ravel() * self.whole.footprint_volume(footprint)

    def missed(self) -> tuple[np.ndarray, np.ndarray]:
        """By what the film and the modes miss, and by what the priors took off, (3 F, 3 F) each."""
        system, count = self.whole.system(self.fit.physics, self.load), len(self.force)
        gain, told = self.whole.gain(system)
        unit = system.unit * self.whole.footprint_volume(self.fit.footprint)
        found = self._of_motion(gain[:count]) * unit**2
        left = (told - np.eye(len(told)))[:count]
        return found, left[:, :count] @ self._true(found) @ left[:, :count].T + unit**2 * left[:, count:] @ left[:, count:].T

    def _of_motion(self, gain: np.ndarray) -> np.ndarray:
        """What errors of the observed motion make of unknowns with this gain (u, K, d), (u, u): as large as what is missed where no force can make up for it, in the
        shapes that were seen and in those of forces in stiff ways, and alike over a quarter period."""
        known = np.flatnonzero(self.whole.known)
        shapes = np.linalg.svd(self.whole.seen.data[known], full_matrices=False)[2][: self.fit.evidence.motion.shapes.shape[2]]
        stiff = shapes_in_stiff_ways(self.whole, self.fit.physics, self.load)
        size = self.whole.sigma_m**2 * missed_in_stiff_ways(self.whole, self.fit.physics, self.solution, self.load, missed=self.told_squared)
        squares = np.r_[np.full(len(shapes), self.missed_m**2 / max(len(shapes), 1)), size]
        same = alike(known, MISSED_PERIODS * self.leading_frames)
        followed = [gain @ shape for shape in (*shapes, *stiff)]
        return sum((square * each @ same @ each.T for square, each in zip(squares, followed, strict=True)), np.zeros((len(gain), len(gain))))

    @property
    def missed_m(self) -> float:
        """Root mean square of what is missed of a frame after the last force, or of all where too few are, at least the tracks' common error [m]."""
        least = self.fit.evidence.motion.coherent_m
        if self.told_m is not None:
            return max(self.told_m, least)
        left = self.whole.missed(self.solution)[without_force(self.whole, self.fit.physics)] * self.whole.sigma_m
        return float(max(np.sqrt((left**2).sum(1).mean()), least))

    def _true(self, found: np.ndarray) -> np.ndarray:
        """Covariance (3 F, 3 F) of forces as large as the one found: at right angles to the body as much as about each frame, in stiff ways the share of that."""
        frames, stiff = np.flatnonzero(self.whole.allowed), self.whole.stiff
        errors = np.einsum("icid,cd->i", found.reshape(2 * [len(frames), 3]), beside(stiff.along))
        across = across_squared(self.force.reshape(-1, 3), frames, stiff.along) + errors
        return np.kron(together(across, frames), stiff.expected + beside(stiff.ways) / stiff.seen_ways)

    def by_physics(self, log10_young_sd: np.ndarray) -> np.ndarray:
        """Changes (3 F, m) by one standard deviation of independent combinations of stiffness and damping."""
        physics, parts = self.fit.physics, len(self.fit.physics.young)
        vector = physics.vector()
        if self.fit.support.has_free_tail:
            bend = Bend.of(self.fit.tail, physics)
            excess = max(self.fit.tail.excess(physics), (self.told_m or 0.0) / self.fit.tail.sigma_m)
            size, axes = np.linalg.eigh(bend.inverse * excess**2)
            steps = axes * np.sqrt(np.maximum(size, 0.0))
        else:
            steps = np.eye(len(vector), parts) * log10_young_sd * np.log(10.0)

        def changed(step: np.ndarray) -> Physics:
            stepped = vector + step
            stepped[parts : parts + 2] = np.maximum(stepped[parts : parts + 2], np.minimum(vector[parts : parts + 2], 0.0))
            return replace(Physics.of(stepped, parts), density=physics.density, poisson=physics.poisson)

        return self._changes(((changed(share * step), None), share) for step, share in _shares(steps))

    def by_material(self, contrast: float) -> np.ndarray:
        """Changes (3 F, m) by one standard deviation of what is open of densities that nobody told, and of Poisson's ratios with them, with what E then takes on."""
        fit, modal = self.fit, self.fit.modal
        body, scene = fit.evidence.body, fit.evidence.settings.scene
        if not fit.support.has_free_tail or scene.density_kg_m3 is not None or len(modal.density) != body.parts:
            return np.zeros((len(self.force), 0))
        changes, ratios, by_young = material_changes(fit.tail, fit.physics, Bend.of(fit.tail, fit.physics), body, scene, contrast, fit.physics.detune, twists=fit.evidence.of_points)

        def weighed(share: float, change: np.ndarray, ratio: np.ndarray, young: np.ndarray) -> tuple[Physics, ModalModel]:
            physics = replace(fit.physics, young=fit.physics.young * np.exp(share * young), poisson=modal.poisson + share * ratio)
            return physics, modal.weighing(modal.density * np.exp(share * change))

        each = zip(_shares(changes), ratios.T, by_young.T, strict=True)
        return self._changes((weighed(share, change, ratio, young), share) for (change, share), ratio, young in each)

    def _changes(self, others: Iterator[tuple[tuple[Physics, ModalModel | None], float]]) -> np.ndarray:
        """Changes (3 F, m) of the net force under other physics and modes, each over its share of a standard deviation."""
        found = [(self._net_under(*other) - self.force) / share for other, share in others]
        return np.array(found).reshape(-1, len(self.force)).T

    def _net_under(self, physics: Physics, modal: ModalModel | None) -> np.ndarray:
        whole = self.whole if modal is None else replace(replace(self.fit, modal=modal).acting, expected=self.whole.expected)
        return self._net(whole.solve(physics, whole.footprint_load(self.fit.footprint)), self.fit.footprint)

    def by_moving_it(self) -> np.ndarray:
        """Changes (3 F, m) by one standard deviation of what is open of a push's place and width."""
        near = open_nearby(self.whole, self.fit.physics, self.fit.footprint, missed=self.told_squared)
        found = [self._net(self.whole.solve_under(self.fit.physics, place), place) - self.force for place in near]
        return np.array(found).reshape(-1, len(self.force)).T

    def by_place(self) -> tuple[np.ndarray, np.ndarray]:
        """The net force (m, 3 F) under the footprints that the motion leaves possible, and how probable it makes each, (m,)."""
        local = self.whole.local_footprints + ([] if self.fit.footprint.family == "uniform" else [self.fit.footprint])
        places = [Footprint(), *local]
        found = [self.whole.solve_under(self.fit.physics, place) for place in places]
        costs = np.array([self.whole.counted_cost(each) for each in found])
        best, between = between_tried(self.whole, self.fit.physics, local, costs[1:], missed=self.told_squared)
        places[1 + best], found[1 + best] = between, self.whole.solve_under(self.fit.physics, between)
        costs[1 + best] = self.whole.counted_cost(found[1 + best])
        weight = probabilities(unlikely(self.whole, self.fit.physics, costs, missed=self.told_squared), before(self.whole, places), 1.0)
        likely = np.flatnonzero(weight > UNLIKELY)
        return np.array([self._net(found[k], places[k]) for k in likely]), weight[likely] / weight[likely].sum()


def _shares(steps: np.ndarray) -> Iterator[tuple[np.ndarray, float]]:
    """Columns of steps (u, m), and the share of each that a difference takes."""
    for step in steps.T:
        yield step, min(1.0, FARTHEST / max(float(np.abs(step).max()), 1e-12))

