"""Force by linear least squares on the modes: one vector per frame under a spatial family, zero off the support."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from ..differences import differences
from ..footprints import Footprint
from ..linear_systems import inverted, solved
from ..modes.interpolation import quadrature
from ..modes.model import ModalModel
from ..modes.response import SLOWEST, Step
from ..vibration.coordinates import Projection
from .along import AXIAL_SHARE, Stiff, beside, both_across, gives_way
from .free_tail import DETUNED, Physics, physical, prior_residual
from .large_swing import LargeSwing

FORCE_SD = 3.0  # of an amplitude, in units of the accelerations seen times the density: wide, it only calms what is not seen [chosen]
FORCE_STEP_SD = 0.3  # of the change from frame to frame, same unit [chosen]
INITIAL_MODES = 6  # whose displacement and rate at frame 0 are unknown when the clip does not start at rest [chosen]
EDGE_GAIN, EDGE_SHARE = 1.0, 0.05  # a frame joins the forced ones at either end for this gain of cost and share of the peak [chosen]
REFINEMENTS = 8  # steps of the fit to all frames [numerical]
CENTRES = (6, 7)  # of the search over footprints, along and across the body [numerical]
WIDTHS = (0.08, 0.16, 0.35, 0.8)  # of the body's length [numerical]
SINGULAR = 1e-12  # added to the normal equations, whose diagonal the priors keep at 0.1 or more: what nothing tells stays zero [numerical]


Believed = Callable[[np.ndarray], np.ndarray]


def nothing(log_young: np.ndarray) -> np.ndarray:
    """Residuals of log E where nothing is believed of it."""
    return log_young[:0]


@dataclass(frozen=True)
class Solution:
    """The force that explains the motion best at given physics."""

    cost: float  # sum of squared misfits over sigma^2 and the priors
    force: np.ndarray  # amplitude [N/m^3], body frame, (T, 3)
    initial_displacement: np.ndarray  # basis coordinates at frame 0, (r,)
    initial_velocity: np.ndarray  # (r,)
    residual: np.ndarray  # all residuals, for least squares


@dataclass(frozen=True)
class System:
    """The linear problem of the force at given physics and footprint; u unknowns: amplitudes of the allowed frames (3 F), then initial displacements and rates."""

    design: np.ndarray  # observed motion per unit of each unknown [m], (T, d, u)
    driven: np.ndarray  # observed motion of modes that products of others drive [m], (T, d)
    unit: float  # of the amplitudes [N/m^3]
    initial_unit: np.ndarray  # of initial displacements and rates, (2, m)
    shapes: np.ndarray  # eigenmodes, (r, r)


@dataclass(frozen=True)
class ForceProblem:
    """All frames of compressed tracks, and what is allowed to act."""

    modal: ModalModel
    seen: Projection
    period_s: float
    known: np.ndarray  # bool, (T,)
    allowed: np.ndarray  # frames that may carry a force, bool, (T,)
    at_rest: bool
    sigma_m: float  # what a frame may miss [m]
    force_unit: float  # accelerations seen times density [N/m^3]
    motion_unit: float  # of the initial basis coordinates: the largest seen
    heaviness: np.ndarray  # of the prior on the size of each frame's force; 1: that of FORCE_SD, (T,)
    along: np.ndarray  # unit vector along the body (start/along.py), (3,)
    has_depth: bool  # whether motion along the line of sight was measured
    common_m: float  # of the tracks' error: what is common to all points [m]
    swing: LargeSwing | None = None  # what goes with the square of the amplitude; None: it is taken off, or there is none
    expected: np.ndarray | None = None  # rows (h, k, F) of what a force as large as that across would cost in the allowed frames and each of the stiff ways, over its unit; None: as of any, but dearer in stiff ways

    @cached_property
    def stiff(self) -> Stiff:
        """Ways in which a force hardly moves the body."""
        return Stiff.of(self.along, self.modal, has_depth=self.has_depth)

    @cached_property
    def uniform_load(self) -> np.ndarray:
        """Modal loads (r, 3) of unit uniform force densities."""
        return self.footprint_load(Footprint())

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (Q, 3) all over the body, the volumes that they stand for [m^3] (Q,), and modal loads (Q, 3, r) of unit densities on these."""
        modal = self.modal
        points, volume, shape = quadrature(modal.nodes, modal.tets)
        basis = modal.basis.reshape(len(modal.nodes), -1)[np.repeat(modal.tets, 4, 0)]
        return points, volume, (volume[:, None] * np.einsum("qn,qnf->qf", shape, basis)).reshape(-1, 3, modal.modes)

    @cached_property
    def _calm(self) -> np.ndarray:
        """Rows of the priors, which are the same whatever the physics and the footprint."""
        return self._calm_of(self.stiff)

    @cached_property
    def _calm_freely(self) -> np.ndarray:
        """The same where a force along the body moves it as one across does."""
        return self._calm_of(self.stiff.freed)

    def _calm_of(self, stiff: Stiff) -> np.ndarray:
        """The same at the prices of these stiff ways, unless it is known what is expected of them."""
        initial = 0 if self.at_rest else min(INITIAL_MODES, self.modal.modes)
        heaviness, unknowns = self.heaviness[self.allowed], 3 * int(self.allowed.sum()) + 2 * initial
        if self.expected is None:
            return _calming(heaviness, stiff.costs, unknowns)
        rows = np.vstack([np.kron(each / share, way) for each, way, share in zip(self.expected, stiff.ways, stiff.shares, strict=True)])
        return np.vstack([_calming(heaviness, beside(stiff.ways), unknowns), np.pad(rows, ((0, 0), (0, unknowns - rows.shape[1])))])

    def _told(self, over_time: np.ndarray) -> np.ndarray:
        """Motions (T, ...) [m] as they count, in standard deviations, in the known frames, (K, ...)."""
        known = over_time[self.known] / self.sigma_m
        return known if self.swing is None else self.swing.products.weighed(known)

    def solve(self, physics: Physics, footprint: np.ndarray, *, freely: bool = False) -> Solution:
        """Regularised least squares for the amplitudes (and the initial motion); footprint (r, 3) from footprint_load. `freely`: a force along the body costs no
        more than one across where it moves the body as well, such as a push on a branch."""
        system = self.system(physics, footprint)
        calm = self._calm_freely if freely and self.moves_along(physics, footprint) else self._calm
        unknown, residual = self._least_squares(system, calm)
        force, split = np.zeros((len(self.known), 3)), 3 * int(self.allowed.sum())
        force[self.allowed] = unknown[:split].reshape(-1, 3) * system.unit
        start = system.initial_unit * unknown[split:].reshape(system.initial_unit.shape)
        displacement, velocity = start @ system.shapes[:, : start.shape[1]].T
        return Solution(float(residual @ residual), force, displacement, velocity, residual)

    def missed(self, solution: Solution) -> np.ndarray:
        """What a solution misses of the known frames, over sigma, (K, d)."""
        return solution.residual[: self.seen.data[self.known].size].reshape(int(self.known.sum()), -1)

    def counted(self, solution: Solution) -> np.ndarray:
        """Residuals by which places of a force are compared. What its priors cost is not among them, for they only calm it: but where the second order is not left open beside
        it, a force makes up for that, and they say how far."""
        return solution.residual if self.swing is None else self.missed(solution).ravel()

    def counted_cost(self, solution: Solution) -> float:
        """The sum of their squares."""
        return float((self.counted(solution) ** 2).sum())

    def solve_under(self, physics: Physics, footprint: Footprint, *, freely: bool = False) -> Solution:
        """The same under a member of a family."""
        return self.solve(physics, self.footprint_load(footprint), freely=freely)

    def moves_along(self, physics: Physics, footprint: np.ndarray) -> bool:
        """Whether a body gives way to a force along it, with modal loads `footprint` (r, 3), by more than AXIAL_SHARE of how far it gives way across."""
        squares, shapes = self.modal.eigen(physics.young, physics.density, physics.poisson)
        along, *across = gives_way(np.maximum(squares, SLOWEST**2), shapes.T @ footprint, np.vstack([self.along, both_across(self.along)]))
        return bool(along > AXIAL_SHARE * max(across))

    def system(self, physics: Physics, footprint: np.ndarray) -> System:
        """What `solve` solves."""
        squares, shapes = self.modal.eigen(physics.young, physics.density, physics.poisson)
        omega2, shapes = physics.detuned(squares).leading(squares, shapes)
        step = Step.of(omega2, physics.damping.decay(omega2), self.period_s)
        seen, frames = self.seen.operator @ shapes, np.flatnonzero(self.allowed)
        unit = self.unit_of(footprint)
        initial_unit = self._initial_unit(omega2)
        design = np.concatenate([self._forced(step, seen, shapes.T @ footprint * unit, frames), self._released(step, seen, initial_unit)], 2)
        return System(design, self._driven(physics, omega2, shapes, seen), unit, initial_unit, shapes)

    def _driven(self, physics: Physics, omega2: np.ndarray, shapes: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Observed motion (T, d) of eigenmodes (r, r) with squared frequencies (r,), seen as (d, r), that products of others drive."""
        if self.swing is None:
            return np.zeros_like(self.seen.data)
        return np.asarray(self.swing.driven(physics.young, omega2, physics.damping.decay(omega2), shapes) @ seen.T)

    def unit_of(self, footprint: np.ndarray) -> float:
        """Of the amplitudes under modal loads `footprint` (r, 3), which then move the body as far as uniform ones [N/m^3]."""
        return float(self.force_unit * np.linalg.norm(self.uniform_load) / np.linalg.norm(footprint))

    def gain(self, system: System) -> tuple[np.ndarray, np.ndarray]:
        """How the unknowns that `solve` finds follow the motion [1/m], (u, K, d) over the known frames, and the true unknowns, (u, u): less than the identity by what
        the priors take off."""
        design = self._told(system.design)
        flat = design.reshape(-1, design.shape[2])
        normal = flat.T @ flat + self._calm.T @ self._calm + SINGULAR * np.eye(flat.shape[1])
        twice = design if self.swing is None else self.swing.products.weighed(design)  # of the motion itself, which is weighed as well
        gain = solved(normal, twice.reshape(flat.shape).T)
        return gain.reshape(len(gain), *design.shape[:2]) / self.sigma_m, solved(normal, flat.T) @ flat

    def _forced(self, step: Step, seen: np.ndarray, load: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """Observed motion (T, d, 3 F) per unit amplitude in each of the frames (F,); load (r, 3) on the eigenmodes."""
        count = len(self.known)
        echo = np.einsum("dk,tk,kc->tdc", seen, step.pulse(count), load, optimize=True)
        design = np.zeros((count, len(seen), len(frames), 3))
        for i, k in enumerate(frames):
            design[k:, :, i] = echo[: count - k]
        return design.reshape(count, len(seen), -1)

    def _initial_unit(self, omega2: np.ndarray) -> np.ndarray:
        """Units of the unknown initial displacements and rates, (2, m); m = 0 at rest."""
        speed = np.sqrt(np.maximum(omega2[: 0 if self.at_rest else INITIAL_MODES], 1.0))
        return self.motion_unit * np.stack([np.ones_like(speed), speed])

    def _released(self, step: Step, seen: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """Observed motion (T, d, 2 m) per unit of initial displacement and rate; displacements are measured from frame 0."""
        count, modes = len(self.known), unit.shape[1]
        history = step.released(count)[:, :, :modes]
        history[:, 0] -= 1.0
        return np.einsum("dk,tjk,jk->tdjk", seen[:, :modes], history, unit).reshape(count, len(seen), 2 * modes)

    def _least_squares(self, system: System, calm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns (u,), and the residuals over sigma followed by those of the priors, whose rows are `calm` (p, u)."""
        matrix = np.concatenate([*self._told(system.design), calm])
        target = np.concatenate([self._told(self.seen.data - system.driven).ravel(), np.zeros(len(calm))])
        normal = matrix.T @ matrix + SINGULAR * np.eye(matrix.shape[1])
        unknown = solved(normal, matrix.T @ target)
        return unknown, target - matrix @ unknown

    def refine(self, physics: Physics, footprint: np.ndarray, *, believed: Believed = nothing) -> Physics:
        """Stiffness, damping and detuning on all frames, the force solved for inside (variable projection): under the force
        the body also shows how it bends at rest. `believed` gives residuals of log E (n,), in standard deviations."""
        (low, high), residual = physics.bounds(), self._residual(physics, footprint, believed)
        start = np.clip(physics.vector(), low + 1e-9, high - 1e-9)
        found = least_squares(residual, start, bounds=(low, high), jac=self._slope(physics, residual), max_nfev=REFINEMENTS, ftol=1e-4)
        return replace(Physics.of(found.x, len(physics.young)), density=physics.density, poisson=physics.poisson)

    def left_open(self, physics: Physics, footprint: np.ndarray, *, believed: Believed = nothing) -> np.ndarray:
        """Standard deviations (n,) of log E [natural] by all that the motion leaves open with the force, the damping and the frequencies free: Gauss-Newton
        about what `refine` found, where a frame misses what it was found to."""
        physics, residual = replace(physics, detune=np.zeros(DETUNED), coupling=None), self._residual(physics, footprint, believed)
        slope, missed = self._slope(physics, residual)(physics.vector()), residual(physics.vector())
        excess = max(float(missed @ missed) / max(int(self.known.sum()) * len(self.seen.operator), 1), 1.0)
        return np.sqrt(excess * np.maximum(np.diag(inverted(slope.T @ slope))[: len(physics.young)], 0.0))

    def _residual(self, physics: Physics, footprint: np.ndarray, believed: Believed) -> Callable[[np.ndarray], np.ndarray]:
        """Misfits over sigma and priors of Physics.vector(), the force solved for inside."""
        parts = len(physics.young)

        def residual(vector: np.ndarray) -> np.ndarray:
            seen = self.solve(replace(Physics.of(vector, parts), density=physics.density, poisson=physics.poisson), footprint).residual
            return np.concatenate([seen, prior_residual(vector, parts), believed(vector[:parts])])

        return residual

    @staticmethod
    def _slope(physics: Physics, residual: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
        return lambda vector: differences(residual, vector, least=physical(len(vector), len(physics.young)))

    def edges(self, physics: Physics) -> tuple[int, int]:
        """How many more frames before and after carry a force: onsets and ends too weak for the recursion show in the motion."""
        found: list[int] = []
        if not self.allowed.any():
            return 0, 0
        for shift in (-1, 1):
            problem, best, count = self, self.solve(physics, self.uniform_load), 0
            while True:
                problem = replace(problem, allowed=problem.allowed | _shifted(problem.allowed, shift))
                trial = problem.solve(physics, self.uniform_load)
                size = np.linalg.norm(trial.force[np.flatnonzero(problem.allowed)[0 if shift < 0 else -1]])
                if best.cost - trial.cost < EDGE_GAIN or size < EDGE_SHARE * np.linalg.norm(trial.force, axis=1).max():
                    break
                best, count = trial, count + 1
            found.append(count)
        return found[0], found[1]

    @property
    def extent(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Lowest and highest x and y of the body [m], and the longer side between them."""
        low, high = self.modal.nodes[:, :2].min(0), self.modal.nodes[:, :2].max(0)
        return low, high, float((high - low).max())

    @property
    def local_footprints(self) -> list[Footprint]:
        """Gaussian ones all over the body, of several widths."""
        low, high, length = self.extent
        centres = [low + (high - low) * ((i + 0.5) / CENTRES[0], (j + 0.5) / CENTRES[1]) for i in range(CENTRES[0]) for j in range(CENTRES[1])]
        return [Footprint("gaussian", np.r_[centre, width * length]) for centre in centres for width in WIDTHS]

    def footprint_load(self, footprint: Footprint) -> np.ndarray:
        """Modal loads (r, 3) of unit amplitudes."""
        points, _, load = self._places
        return np.tensordot(footprint.weights(points), load, 1).T

    def footprint_volume(self, footprint: Footprint) -> float:
        """Net force over amplitude [m^3]."""
        points, volume, _ = self._places
        return float(footprint.weights(points) @ volume)


def _shifted(flags: np.ndarray, by: int) -> np.ndarray:
    """Flags moved by one frame forwards (1) or backwards (-1)."""
    return np.r_[False, flags[:-1]] if by > 0 else np.r_[flags[1:], False]


def _calming(heaviness: np.ndarray, costs: np.ndarray, unknowns: int) -> np.ndarray:
    """Rows of the priors on the force amplitudes: size, weighted frame by frame (F,) and by direction (3, 3), and change from frame to frame."""
    frames = len(heaviness)
    size = np.eye(3 * frames, unknowns)
    size[:, : 3 * frames] = np.kron(np.diag(np.sqrt(heaviness)), costs) / FORCE_SD
    change = np.kron(np.diff(np.eye(frames), axis=0), costs) / FORCE_STEP_SD
    initial = np.eye(unknowns)[3 * frames :]
    return np.vstack([size, np.pad(change, ((0, 0), (0, unknowns - 3 * frames))), initial])
