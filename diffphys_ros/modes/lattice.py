"""Apparent stiffness of the solver's grid on this very body: small vibrations of the MLS-MPM lattice itself.

Quadratic B-splines, one quadrature point per particle with the affine (APIC) velocity gradient of MLS-MPM
(C = 4/dx^2 sum_i w_i v_i (x_i - x_p)^T, Hu et al. 2018), lumped grid mass, clamped nodes held. numpy and scipy only.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from ..types import Body, Grid, Particles
from .model import ModalModel

LIGHT = 0.05  # nodes below this share of the heaviest mass hardly hold the body; their mass is made to fall with their stiffness
EMPTY = 1e-4  # nodes below this share are left out
SOUGHT = 8  # lattice modes among which the body's leading one is looked for
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


def apparent_stiffness(particles: Particles, grid: Grid, body: Body, young: np.ndarray, modal: ModalModel) -> float:
    """E_apparent / E of the grid: squared ratio of the lattice's frequency to the finite elements' in the leading mode.

    A fit on the grid is too stiff by the inverse: E_true = E_fit * E_apparent / E. Gravity is left out on both sides; the
    lattice's mode is the one whose shape is nearest to the elements'.

    Args:
        particles, grid: as the solver uses them, ghosts included.
        body: for the clamp; a body that is free to move has no such mode and gives 1.
        young: Young's moduli [Pa], (n,).
        modal: modes of the same body.
    """
    if not body.clamped:
        return 1.0
    lattice = Lattice(particles, grid)
    omega2, shapes = np.linalg.eigh(modal.elastic(young))
    own = particles.own
    leading = np.einsum("mcr,r->mc", modal.evaluate(particles.x_rest[own])[0], shapes[:, 0])
    found, modes = lattice.eigenmodes(np.asarray(young, float)[particles.part - 1], SOUGHT)
    seen = lattice.at_particles(modes)[own]
    weight = particles.mass[own]
    overlap = np.einsum("m,mc,mck->k", weight, leading, seen) ** 2 / np.einsum("m,mck->k", weight, seen**2)
    return float(found[overlap.argmax()] / omega2[0])


class Lattice:
    """Matrices of the grid that carries the particles.

    Attributes:
        free: numbers of the free nodes among the touched ones, (F,).
        mass: of the free degrees of freedom [kg], (3 F,).
    """

    def __init__(self, particles: Particles, grid: Grid):
        relative = (particles.x_rest - grid.origin) / grid.dx
        base = np.floor(relative - 0.5).astype(int)
        nodes, weights = _stencil(relative, base)
        held = nodes[..., 0] <= grid.clamp_index
        number = np.ravel_multi_index(tuple(np.moveaxis(nodes, -1, 0)), grid.size)
        touched, column = np.unique(number, return_inverse=True)
        column = column.reshape(number.shape)
        mass = np.bincount(column.ravel(), (weights * particles.mass[:, None]).ravel())
        clamped = np.zeros(len(touched), bool)
        clamped[column[held]] = True
        self._particles = particles
        self.free = np.flatnonzero(~clamped & (mass > EMPTY * mass.max()))
        floor = LIGHT * mass.max()
        self.mass = np.repeat(np.where(mass < floor, mass**2 / floor, mass)[self.free], 3)
        arm = (nodes - relative[:, None]) * (4 / grid.dx)  # 4/dx^2 (x_i - x_p)
        self._value = self._matrix(weights, column, len(touched))
        self._slope = [self._matrix(weights * arm[..., a], column, len(touched)) for a in range(3)]

    def _matrix(self, entries: np.ndarray, column: np.ndarray, count: int) -> sp.csr_matrix:
        row = np.repeat(np.arange(len(entries)), entries.shape[1])
        return sp.csr_matrix((entries.ravel(), (row, column.ravel())), (len(entries), count))[:, self.free]

    def stiffness(self, young: np.ndarray) -> sp.csc_matrix:
        """Small-strain stiffness (3 F, 3 F) at Young's modulus per particle (P,) [Pa]."""
        nu, volume = self._particles.poisson, self._particles.volume
        lam, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
        axis = [sp.csr_matrix(([1.0], ([0], [a])), (1, 3)) for a in range(3)]
        strain = {}
        for a, b in _PAIRS:
            rows = sp.kron(self._slope[b], axis[a])
            strain[a, b] = (rows if a == b else rows + sp.kron(self._slope[a], axis[b])).tocsr()
        dilation = strain[0, 0] + strain[1, 1] + strain[2, 2]
        total = dilation.T @ sp.diags(volume * lam) @ dilation
        for (a, b), rows in strain.items():
            total = total + rows.T @ sp.diags(volume * mu * (2.0 if a == b else 1.0)) @ rows
        return total.tocsc()

    def eigenmodes(self, young: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """The lowest squared angular frequencies [1/s^2] and shapes (3 F, count)."""
        matrix = self.stiffness(young)
        solve = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve
        start = np.random.default_rng(0).standard_normal(len(self.mass))
        inverse = LinearOperator(matrix.shape, matvec=solve, dtype=float)
        return eigsh(matrix, count, sp.diags(self.mass).tocsc(), sigma=0.0, OPinv=inverse, v0=start, tol=1e-6)

    def at_particles(self, shapes: np.ndarray) -> np.ndarray:
        """Displacements (P, 3, k) of the particles in nodal shapes (3 F, k)."""
        return np.stack([self._value @ shapes[a::3] for a in range(3)], 1)


def _stencil(relative: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Node indices (P, 27, 3) and weights (P, 27) of quadratic B-splines at positions in cells (P, 3)."""
    offset = relative - base
    weight = np.stack([0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1) ** 2, 0.5 * (offset - 0.5) ** 2], 1)
    steps = np.array(list(np.ndindex(3, 3, 3)))
    product = weight[:, steps[:, 0], 0] * weight[:, steps[:, 1], 1] * weight[:, steps[:, 2], 2]
    return base[:, None] + steps, product
