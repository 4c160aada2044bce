"""The body's motion in a few modes: a Ritz basis on a finite-element mesh, its stiffness per part. numpy and scipy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from ..damping import Damping
from ..differences import differences
from ..linear_systems import solved
from . import interpolation
from .detuned import Detuned, mixed
from .response import SLOWEST, Step, convolve

LOG_STEP = 1e-4  # of log E, for differences of the exact response (float64: 8 digits are left) [numerical]
DAMPING_STEP = (1e-3, 1e-6)  # of alpha [1/s] and beta [s] [numerical]

Weight = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class ModalModel:
    """Small motions u(x, t) = sum_k basis_k(x) q_k(t) of the body about its shape in frame 0, body frame.

    The basis is mass-orthonormal, so that with load p_k = integral of f . basis_k dV
    q'' + (alpha + beta K) q' + K q = p,  K = sum_i young_i stiffness_i + geometric + retuning,
    and at the Young's moduli of `reference` its vectors are the eigenmodes, lowest first. Strain energy of gravity's
    prestress enters as `geometric` (independent of a common factor of all moduli); `retuning` is what the body's frequencies
    were seen to differ from the elements'. What goes with density may be kept part by part, for others than `density`. With other Poisson's ratios nu' than
    nu, `stiffness` changes by `by_poisson` times (1 + nu) (nu' - nu) / (1 + nu'): right to first order, and twisting, whose stiffness is E / (1 + nu), exactly.
    """

    nodes: np.ndarray  # of quadratic tetrahedra, body frame [m], (N, 3)
    tets: np.ndarray  # node numbers in the order of interpolation.py, (E, 10)
    part: np.ndarray  # of the elements, 1..n, (E,)
    basis: np.ndarray  # [kg^-1/2], (N, 3, r)
    stiffness: np.ndarray  # per part and Pa [1/(Pa s^2)], (n, r, r)
    by_poisson: np.ndarray  # its derivatives by the part's Poisson's ratio, (n, r, r)
    poisson: np.ndarray  # the ratios that it is of, (n,)
    inertia: np.ndarray  # products of the basis vectors, whose sum is the identity, of what may have densities of its own: parts, or all: (m, r, r)
    prestress: np.ndarray  # by their weights [1/s^2], (m, r, r)
    weight: np.ndarray  # modal loads of their weights [N/kg^1/2], (m, r)
    density: np.ndarray  # theirs [kg/m^3], (m,)
    retuning: np.ndarray  # [1/s^2], (r, r)
    reference: np.ndarray  # Young's moduli [Pa] at which the basis is diagonal, (n,)
    _last: ClassVar[tuple[bytes, np.ndarray, np.ndarray] | None] = None  # what `eigen` was asked last, and what it answered

    @property
    def modes(self) -> int:
        """Number of basis vectors r."""
        return self.basis.shape[2]

    @property
    def geometric(self) -> np.ndarray:
        """Stiffness of gravity's prestress [1/s^2], (r, r)."""
        return self.prestress.sum(0)

    @property
    def gravity_load(self) -> np.ndarray:
        """Modal loads of the weight [N/kg^1/2], (r,)."""
        return self.weight.sum(0)

    def elastic(self, young: np.ndarray, poisson: np.ndarray | None = None) -> np.ndarray:
        """The elastic part of K [1/s^2] (r, r) at Young's moduli (n,) [Pa] and Poisson's ratios (n,); None: those of the model."""
        return np.einsum("i,iab->ab", np.asarray(young, float), self.stiffness if poisson is None else self._squeezed(poisson))

    def _squeezed(self, poisson: np.ndarray) -> np.ndarray:
        """The stiffness per part and Pa (n, r, r) at other Poisson's ratios."""
        change = (1 + self.poisson) * (poisson - self.poisson) / (1 + poisson)
        return self.stiffness + change[:, None, None] * self.by_poisson

    def matrix(self, young: np.ndarray, poisson: np.ndarray | None = None) -> np.ndarray:
        """K [1/s^2] (r, r) at Young's moduli (n,) [Pa] and Poisson's ratios (n,); None: those of the model."""
        return self.elastic(young, poisson) + self.geometric + self.retuning

    def eigen(self, young: np.ndarray, density: np.ndarray | None = None, poisson: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Squared angular frequencies (r,) [1/s^2], lowest first, and mass-orthonormal mode shapes (r, r) as columns of basis coordinates,
        at Young's moduli (n,) [Pa], densities (m,) [kg/m^3] and Poisson's ratios (n,); None: those of the model.

        A negative square means that the body buckles under gravity at these moduli. The last answer is kept: searches ask for the same
        moduli again and again while they try dampings, forces and where these act.
        """
        asked, last = np.concatenate([young, *((np.nan,) if each is None else each for each in (density, poisson))]).tobytes(), self._last
        if last is None or last[0] != asked:
            last = (asked, *(np.linalg.eigh(self.matrix(young, poisson)) if density is None else self._eigen_of(self.elastic(young, poisson), density / self.density)))
            object.__setattr__(self, "_last", last)
        return last[1].copy(), last[2].copy()

    def _eigen_of(self, elastic: np.ndarray, heavier: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of what is so many times as heavy (m,)."""
        stiffness = elastic + self.retuning + np.tensordot(heavier, self.prestress, 1)
        squares, shapes = eigh(stiffness, np.tensordot(heavier, self.inertia, 1))
        return squares, shapes

    def eigen_changes(
        self, young: np.ndarray, density: np.ndarray | None = None, poisson: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The squares (r,) of `eigen`, and derivatives by log E of each part, then by log density where densities are given, then by Poisson's ratio
        where ratios are given: of the squares, (S, r), and of the shapes, (S, r, r) as `eigen` gives them.

        Rayleigh and Schroedinger, with changes dK of the stiffness and dM of the inertia: d square_j = s_j' (dK - square_j dM) s_j,
        d s_j = sum over i of s_i (s_i' (dK - square_j dM) s_j) / (square_j - square_i) - s_j (s_j' dM s_j) / 2. What modes of equal frequency turn
        among themselves changes no motion and is left out.
        """
        squares, shapes = self.eigen(young, density, poisson)
        each_young = np.asarray(young, float)[:, None, None]
        change = shapes.T @ (each_young * (self.stiffness if poisson is None else self._squeezed(poisson))) @ shapes
        own = np.zeros((len(change), self.modes))
        if density is not None:
            stress, inertia = (shapes.T @ ((density / self.density)[:, None, None] * each) @ shapes for each in (self.prestress, self.inertia))
            change = np.concatenate([change, stress - squares * inertia])
            own = np.concatenate([own, -0.5 * np.diagonal(inertia, axis1=1, axis2=2)])
        if poisson is not None:
            change = np.concatenate([change, shapes.T @ (each_young * self._by_ratio(poisson)) @ shapes])
            own = np.pad(own, ((0, len(poisson)), (0, 0)))
        return squares, np.diagonal(change, axis1=1, axis2=2), shapes @ (mixed(change, squares) + own[:, :, None] * np.eye(self.modes))

    def _by_ratio(self, poisson: np.ndarray) -> np.ndarray:
        """Derivatives of the stiffness per part and Pa (n, r, r) by Poisson's ratio, at ratios (n,)."""
        return (((1 + self.poisson) / (1 + poisson)) ** 2)[:, None, None] * self.by_poisson

    def frequencies(self, young: np.ndarray) -> np.ndarray:
        """Undamped frequencies [Hz] (r,), lowest first; 0 where the body buckles."""
        return np.sqrt(np.maximum(self.eigen(young)[0], 0.0)) / (2 * np.pi)

    def evaluate(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Basis at body points (M, 3): values (M, 3, r) and gradients (M, 3, 3, r), gradient[:, i, j] = d u_i / d x_j [1/m].

        Exact inside the mesh; outside it continues linearly from the nearest element.
        """
        value, slope = interpolation.evaluate(self.nodes, self.tets, self.basis, points)
        return value, np.swapaxes(slope, 1, 2)

    def load(self, points: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """Modal loads (r, 3) of unit force densities along x, y, z at points (M, 3) that carry volumes `weight` (M,) [m^3]."""
        return np.einsum("m,mcr->rc", weight, self.evaluate(points)[0])

    def footprint_load(self, weight: Weight | None = None) -> np.ndarray:
        """Modal loads (r, 3) of unit force densities along x, y, z times weight(points), integrated over the body."""
        points, volume, shape = interpolation.quadrature(self.nodes, self.tets)
        scale = volume if weight is None else volume * weight(points)
        nodal = np.zeros(len(self.nodes))
        np.add.at(nodal, np.repeat(self.tets, 4, 0), scale[:, None] * shape)
        return np.einsum("n,ncr->rc", nodal, self.basis)

    def gravity_coordinates(self, young: np.ndarray) -> np.ndarray:
        """Basis coordinates (r,) of the static displacement under gravity: frame 0 minus the stress-free shape, to first order."""
        return solved(self.elastic(young), self.gravity_load)

    def strain_by_weight(self, young: np.ndarray) -> float:
        """Largest principal strain of that displacement, whatever its sign: a factor on all moduli (n,) [Pa] divides it."""
        _, slope = interpolation.at_quadrature(self.nodes, self.tets, self.basis @ self.gravity_coordinates(young))
        return float(np.abs(np.linalg.eigvalsh(0.5 * (slope + np.swapaxes(slope, 1, 2)))).max())

    def step(self, young: np.ndarray, damping: Damping[float], period_s: float) -> tuple[Step, np.ndarray]:
        """Exact transition of the eigenmodes over a frame, and their shapes (r, r)."""
        omega2, shapes = self.eigen(young)
        omega2 = np.maximum(omega2, SLOWEST**2)
        return Step.of(omega2, damping.decay(omega2), period_s), shapes

    def respond(
        self,
        young: np.ndarray,
        *,
        damping: Damping[float],
        load: np.ndarray,
        period_s: float,
        initial_displacement: np.ndarray | None = None,
        initial_velocity: np.ndarray | None = None,
    ) -> np.ndarray:
        """Basis coordinates (T, r) at the frame times; load (T, r) [N/kg^1/2] is constant within a frame (load[k] acts in
        [t_k, t_k+1)). Exact for the linear model, whatever the frequencies."""
        step, shapes = self.step(young, damping, period_s)
        free = np.zeros(load.shape)
        for start, history in zip((initial_displacement, initial_velocity), np.swapaxes(step.released(len(load)), 0, 1), strict=True):
            if start is not None:
                free += history * (shapes.T @ start)
        return (free + convolve(step.pulse(len(load)), load @ shapes)) @ shapes.T

    def jacobian(
        self,
        young: np.ndarray,
        *,
        damping: Damping[float],
        footprint: np.ndarray,
        force: np.ndarray,
        frames: np.ndarray,
        period_s: float,
        initial_displacement: np.ndarray | None = None,
        initial_velocity: np.ndarray | None = None,
        initial_modes: int = 0,
    ) -> np.ndarray:
        """Derivatives (T, r, S) of the basis coordinates in the order of S = n + 2 + 3 F + 2 m unknowns: log E per part,
        alpha, beta, force amplitudes (F, 3) in `frames` (F,), then m = initial_modes initial displacements and rates.

        footprint (r, 3) is what `footprint_load` gives, force (T, 3) [N/m^3]. The last two groups enter linearly and are
        exact; the others are central differences of the exact response.
        """
        young = np.asarray(young, float)
        n, count = len(young), len(force)

        def at(change: np.ndarray) -> np.ndarray:
            return self.respond(
                young * np.exp(change[:n]),
                damping=Damping(damping.mass_per_s + change[n], damping.stiffness_s + change[n + 1]),
                load=force @ footprint.T,
                period_s=period_s,
                initial_displacement=initial_displacement,
                initial_velocity=initial_velocity,
            )

        least = np.r_[np.full(n, -np.inf), -damping.mass_per_s, -damping.stiffness_s]  # a damping below 0 blows up what is stiff
        physics = differences(at, np.zeros(n + 2), step=np.r_[np.full(n, LOG_STEP), DAMPING_STEP], least=least)
        step, shapes = self.step(young, damping, period_s)
        pulse, forced = step.pulse(count), np.zeros((count, self.modes, len(frames), 3))
        for i, k in enumerate(frames):
            forced[k:, :, i] = np.einsum("as,ts,sc->tac", shapes, pulse[: count - k], shapes.T @ footprint)
        released = np.einsum("as,tjs,bs->tajb", shapes, step.released(count), shapes[:initial_modes])
        return np.concatenate([physics, forced.reshape(count, self.modes, -1), released.reshape(count, self.modes, -1)], -1)

    def track_jacobian(self, points: np.ndarray, young: np.ndarray, **motion: object) -> np.ndarray:
        """Derivatives (T, M, 3, S) of the displacements of body points (M, 3); the unknowns and the other arguments are
        those of `jacobian`."""
        return np.einsum("mcr,trs->tmcs", self.evaluate(points)[0], self.jacobian(young, **motion), optimize=True)  # type: ignore[arg-type]

    def retuned(self, young: np.ndarray, detune: np.ndarray, coupling: np.ndarray | None = None) -> ModalModel:
        """The same model whose leading frequencies at `young` are exp(detune) (k,) times as high; the shapes stay, but for modes that are coupled to their
        next by `coupling`, (k - 1,), see detuned.py."""
        omega2, shapes = self.eigen(young)
        change = Detuned.of(omega2, detune, coupling).change
        leading = shapes[:, : len(change)]
        return replace(self, retuning=self.retuning + leading @ change @ leading.T)

    def weighing(self, density: np.ndarray) -> ModalModel:
        """The same body with other densities (m,) [kg/m^3], on the span of the same shapes."""
        heavier = density / self.density
        inertia, prestress, weight = heavier[:, None, None] * self.inertia, heavier[:, None, None] * self.prestress, heavier[:, None] * self.weight
        turn = solve_triangular(cholesky(inertia.sum(0), lower=True), np.eye(self.modes), lower=True).T  # to a mass-orthonormal basis
        return replace(self._turned(turn), inertia=turn.T @ inertia @ turn, prestress=turn.T @ prestress @ turn, weight=weight @ turn, density=density)

    def squeezing(self, poisson: np.ndarray) -> ModalModel:
        """The same body with other Poisson's ratios (n,), on the span of the same shapes."""
        poisson = np.asarray(poisson, float)
        return replace(self, stiffness=self._squeezed(poisson), by_poisson=self._by_ratio(poisson), poisson=poisson)

    def rotated(self, young: np.ndarray, modes: int | None = None) -> ModalModel:
        """The same model with the eigenmodes at `young` as basis; only the lowest `modes` of them where given."""
        shapes = self.eigen(young)[1][:, :modes]
        flat = (self.basis @ shapes).reshape(-1, shapes.shape[1])
        shapes = shapes * np.sign(flat[np.abs(flat).argmax(0), np.arange(shapes.shape[1])])  # equal input, equal signs
        return replace(self._turned(shapes), reference=np.asarray(young, float).copy())

    def _turned(self, turn: np.ndarray) -> ModalModel:
        """The same model on the basis vectors that the columns (r, s) say."""
        return replace(
            self,
            basis=self.basis @ turn,
            stiffness=turn.T @ self.stiffness @ turn,
            by_poisson=turn.T @ self.by_poisson @ turn,
            inertia=turn.T @ self.inertia @ turn,
            prestress=turn.T @ self.prestress @ turn,
            weight=self.weight @ turn,
            retuning=turn.T @ self.retuning @ turn,
        )
