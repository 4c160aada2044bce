"""Another solid than the generator's: Neo-Hookean, 27-node hexahedra on a box grid, implicit midpoint steps. numpy and scipy alone.

The scenes' generator has corotational linear elements and an integrator that damps by its own step. Here the law is finite-strain
(Simo and Pister: S = mu (1 - C^-1) + lambda ln J C^-1), damping brakes the rate of Green's strain, and the steps lose no energy of
their own (Simo, Tarnow and Wong 1992, for what is quadratic). A recovery that is right for one of the two alone has learnt a simulator.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
CONVERGED = 1e-9  # largest residual over the largest load that counts
ROUNDED = 1e-13  # of the force that a strain of one makes on a cell: forces smaller than that are lost in rounding
ROUNDS = 40  # of Newton's, with a matrix that is made anew where it stops helping
IDENTITY = np.eye(3)


def _shape_1d(x: float) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions at nodes -1, 0, 1, and their derivatives."""
    return np.array([x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2]), np.array([x - 0.5, -2 * x, x + 0.5])


def _cell(size: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a box: shape functions (Q, 27), their gradients (Q, 27, 3) [1/m] and weights (Q,) [m^3] at 27 Gauss points; last axis fastest."""
    values, slopes, weights = [], [], []
    for i, j, k in np.ndindex(3, 3, 3):
        (nx, dx), (ny, dy), (nz, dz) = (_shape_1d(POINTS[axis]) for axis in (i, j, k))
        values.append(np.einsum("i,j,k->ijk", nx, ny, nz).ravel())
        slopes.append(np.stack([np.einsum("i,j,k->ijk", *each).ravel() for each in ((dx, ny, nz), (nx, dy, nz), (nx, ny, dz))], -1) * 2 / size)
        weights.append(WEIGHTS[i] * WEIGHTS[j] * WEIGHTS[k] * np.prod(size) / 8)
    return np.array(values), np.array(slopes), np.array(weights)


@dataclass(frozen=True)
class Step:
    """How positions and velocities [1/s] depend on what is sought."""

    moved: float
    sped: float


@dataclass
class Solid:
    """Cells of one size on a grid, each of one material.

    Args:
        filled: integer (C, 3), the filled cells.
        size: of a cell [m], (3,).
        origin: corner of cell (0, 0, 0) [m], (3,).
        young, poisson, density: by cell, (C,), [Pa], 1, [kg/m^3].
        mass_damping: [1/s]; stiffness_damping: [s], of the rate of strain.
    """

    filled: np.ndarray
    size: np.ndarray
    origin: np.ndarray
    young: np.ndarray
    poisson: np.ndarray
    density: np.ndarray
    mass_damping: float = 0.0
    stiffness_damping: float = 0.0
    nodes: np.ndarray = field(init=False)  # [m], (N, 3)
    index: np.ndarray = field(init=False)  # of the nodes on the grid of half cells, (N, 3)
    cells: np.ndarray = field(init=False)  # node numbers, (C, 27)

    def __post_init__(self) -> None:
        offsets = np.array(list(np.ndindex(3, 3, 3)))
        every = (2 * self.filled[:, None] + offsets).reshape(-1, 3)
        self.index, number = np.unique(every, axis=0, return_inverse=True)
        self.cells = number.reshape(len(self.filled), 27)
        self.nodes = self.origin + self.index * self.size / 2
        self._values, self._slopes, self._weights = _cell(self.size)
        self._mu = (self.young / (2 * (1 + self.poisson)))[:, None]
        self._lam = (self.young * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson)))[:, None]
        dofs = (3 * self.cells[:, :, None] + np.arange(3)).reshape(len(self.cells), 81)
        self._rows, self._columns = np.repeat(dofs, 81, 1).ravel(), np.tile(dofs, 81).ravel()
        self.mass = self._mass()

    def _mass(self) -> sparse.csr_matrix:
        one = np.einsum("q,qa,qb->ab", self._weights, self._values, self._values)
        three = np.einsum("ab,ij->aibj", one, IDENTITY).reshape(81, 81)
        return self._assembled(self.density[:, None, None] * three)

    def _assembled(self, blocks: np.ndarray) -> sparse.csr_matrix:
        n = 3 * len(self.nodes)
        return sparse.csr_matrix((blocks.ravel(), (self._rows, self._columns)), (n, n))

    def load(self, density: np.ndarray) -> np.ndarray:
        """Nodal forces [N] (3 N,) of a force density at the nodes (N, 3) [N/m^3]."""
        at = np.einsum("qa,cai->cqi", self._values, density[self.cells])
        total = np.zeros_like(self.nodes)
        np.add.at(total, self.cells, np.einsum("q,qa,cqi->cai", self._weights, self._values, at))
        return total.ravel()

    def weight(self, gravity: np.ndarray) -> np.ndarray:
        """Nodal forces [N] (3 N,) of gravity [m/s^2]."""
        return np.asarray(self.mass @ np.tile(gravity, len(self.nodes)))

    def volume(self) -> np.ndarray:
        """Share of each node [m^3], (N,)."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.cells, np.broadcast_to(self._weights @ self._values, self.cells.shape))
        return total

    @property
    def rounding_n(self) -> float:
        """Internal force [N] that counts as nothing."""
        return ROUNDED * float((2 * self._mu + self._lam).max() * np.max(self.size) ** 2)

    def energy(self, u: np.ndarray) -> float:
        """Strain energy [J] of displacements (N, 3)."""
        f = IDENTITY + self._gradient(u)
        log_j, square = np.log(np.linalg.det(f)), (f**2).sum((2, 3))
        return float((self._weights * (self._mu * ((square - 3) / 2 - log_j) + self._lam * log_j**2 / 2)).sum())

    def force(self, u: np.ndarray, v: np.ndarray, step: Step | None = None) -> tuple[np.ndarray, sparse.csr_matrix | None]:
        """Internal forces [N] (3 N,) at displacements u and velocities v (N, 3), and their derivative by the unknown of a step."""
        f, rate = IDENTITY + self._gradient(u), self._gradient(v)
        inverse = np.linalg.inv(np.swapaxes(f, 2, 3) @ f)
        log_j = np.log(np.linalg.det(f))[..., None, None]
        mu, lam = self._mu[..., None, None], self._lam[..., None, None]
        strain_rate = np.swapaxes(f, 2, 3) @ rate
        strain_rate = 0.5 * (strain_rate + np.swapaxes(strain_rate, 2, 3))
        viscous = self.stiffness_damping * (lam * np.trace(strain_rate, axis1=2, axis2=3)[..., None, None] * IDENTITY + 2 * mu * strain_rate)
        stress = mu * (IDENTITY - inverse) + lam * log_j * inverse + viscous
        total = np.zeros_like(self.nodes)
        np.add.at(total, self.cells, np.einsum("q,qaJ,cqiJ->cai", self._weights, self._slopes, f @ stress, optimize=True))
        return total.ravel(), None if step is None else self._assembled(self._tangent(f, rate, inverse, log_j, stress, step))

    def _gradient(self, u: np.ndarray) -> np.ndarray:
        return np.einsum("cai,qaJ->cqiJ", u.reshape(-1, 3)[self.cells], self._slopes, optimize=True)

    def _tangent(self, f: np.ndarray, rate: np.ndarray, inverse: np.ndarray, log_j: np.ndarray, stress: np.ndarray, step: Step) -> np.ndarray:
        mu, lam = self._mu[..., None, None, None, None], self._lam[..., None, None, None, None]
        swapped = np.einsum("cqIK,cqJL->cqIJKL", inverse, inverse) + np.einsum("cqIL,cqJK->cqIJKL", inverse, inverse)
        elastic = lam * np.einsum("cqIJ,cqKL->cqIJKL", inverse, inverse) + (mu - lam * log_j[..., None, None]) * swapped
        both = np.einsum("IK,JL->IJKL", IDENTITY, IDENTITY) + np.einsum("IL,JK->IJKL", IDENTITY, IDENTITY)
        viscous = self.stiffness_damping * (lam * np.einsum("IJ,KL->IJKL", IDENTITY, IDENTITY) + mu * both)
        change = step.moved * np.einsum("ik,cqLJ->cqiJkL", IDENTITY, stress)
        change += np.einsum("cqiI,cqIJKL,cqkK->cqiJkL", f, step.moved * elastic, f, optimize=True)
        change += np.einsum("cqiI,cqIJKL,cqkK->cqiJkL", f, np.broadcast_to(viscous, elastic.shape), step.moved * rate + step.sped * f, optimize=True)
        half = np.einsum("q,qaJ,cqiJkL->cqaikL", self._weights, self._slopes, change, optimize=True)
        return np.einsum("cqaikL,qbL->caibk", half, self._slopes, optimize=True).reshape(-1, 81, 81)


@dataclass
class Marcher:
    """Moves the nodes of a solid that are free. States are displacements and velocities (N, 3)."""

    solid: Solid
    free: np.ndarray  # bool, (N,)
    _lu: object = None
    _of: float = 0.0  # step of the matrix [s]

    @property
    def _dofs(self) -> np.ndarray:
        return np.flatnonzero(np.repeat(self.free, 3))

    def equilibrium(self, load: np.ndarray, steps: int = 5) -> np.ndarray:
        """Displacements (N, 3) under nodal forces (3 N,) [N]."""
        u, dofs = np.zeros_like(self.solid.nodes), self._dofs
        for share in np.arange(1, steps + 1) / steps:
            for _ in range(ROUNDS):
                inner, matrix = self.solid.force(u, np.zeros_like(u), Step(1.0, 0.0))
                missed = (share * load - inner)[dofs]
                if np.abs(missed).max() <= max(CONVERGED * np.abs(load).max(), self.solid.rounding_n):
                    break
                u.reshape(-1)[dofs] += splu(matrix[dofs][:, dofs].tocsc()).solve(missed)
            else:
                raise RuntimeError("no equilibrium was found")
        return u

    def stepped(self, u: np.ndarray, v: np.ndarray, load: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray]:
        """One implicit midpoint step under nodal forces (3 N,) at its middle."""
        solid, dofs = self.solid, self._dofs
        inertia = solid.mass * (2 / step_s**2 + solid.mass_damping / step_s)
        held = solid.mass @ (2 / step_s * v).ravel()
        new, before = u + step_s * v, np.inf
        for _ in range(ROUNDS):
            middle, speed = 0.5 * (u + new), (new - u) / step_s
            inner = solid.force(middle, speed)[0]
            missed = (load + held - inertia @ (new - u).ravel() - inner)[dofs]
            size = float(np.abs(missed).max())
            if size <= max(CONVERGED * max(np.abs(each[dofs]).max() for each in (load, held, inner)), solid.rounding_n):
                return new, 2 * speed - v
            if self._lu is None or self._of != step_s or size > 0.2 * before:
                matrix = solid.force(middle, speed, Step(0.5, 1 / step_s))[1] + inertia
                self._lu, self._of = splu(matrix[dofs][:, dofs].tocsc()), step_s
            before = size
            new = new.copy()
            new.reshape(-1)[dofs] += self._lu.solve(missed)
        raise RuntimeError("a step does not converge; take smaller ones")
