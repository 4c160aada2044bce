"""Apparent stiffness of the solver's grid on this very body: small deformations of the MLS-MPM lattice itself.

Quadratic B-splines, one quadrature point per particle with the affine (APIC) velocity gradient of MLS-MPM
(C = 4/dx^2 sum_i w_i v_i (x_i - x_p)^T, Hu et al. 2018), clamped nodes held. numpy and scipy only.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..types import Body, Grid, Particles
from .model import ModalModel

FLOOR = 1e-10  # of the diagonal, added to it: nodes that particles only touch have next to no stiffness
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


def apparent_stiffness(particles: Particles, grid: Grid, body: Body, young: np.ndarray, modal: ModalModel) -> float:
    """E_apparent / E of the grid: squared ratio of the lattice's frequency to the finite elements' in the leading mode.

    A fit on the grid is too stiff by the inverse: E_true = E_fit * E_apparent / E. Gravity is left out on both sides. The
    lattice's frequency is Timoshenko's quotient of the elements' mode phi, right to second order in the difference of the shapes:
    omega^2 = sum m |phi|^2 / (f . K^-1 f) with the inertial load f of the particles, lowered by the spin that APIC's affine
    velocities carry (inertia m dx^2 / 4 per particle).

    Args:
        particles, grid: as the solver uses them, ghosts included.
        body: for the clamp; a body that is free to move rigidly gives 1.
        young: Young's moduli [Pa], (n,).
        modal: modes of the same body.
    """
    if not body.clamped:
        return 1.0
    lattice = Lattice(particles, grid)
    omega2, shapes = np.linalg.eigh(modal.elastic(young))
    leading, slope = (field @ shapes[:, 0] for field in modal.evaluate(particles.x_rest))
    mass = np.where(particles.ghost, 0.0, particles.mass)
    compliance = lattice.compliance(np.asarray(young, float)[particles.part - 1], mass[:, None] * leading)
    motion, spin = mass @ (leading**2).sum(1), mass @ (slope**2).sum((1, 2)) * grid.dx**2 / 4
    return float(motion / (omega2[0] * compliance) * motion / (motion + spin))


class Lattice:
    """Matrices of the grid that carries the particles, over its F free nodes.

    Attributes:
        node_indices: of the free nodes, (F, 3).
    """

    def __init__(self, particles: Particles, grid: Grid):
        relative = (particles.x_rest - grid.origin) / grid.dx
        base = np.floor(relative - 0.5).astype(int)
        nodes, weights = _stencil(relative, base)
        held = nodes[..., 0] <= grid.clamp_index
        number = np.ravel_multi_index(tuple(np.moveaxis(nodes, -1, 0)), grid.size)
        touched, column = np.unique(number, return_inverse=True)
        column = column.reshape(number.shape)
        clamped = np.zeros(len(touched), bool)
        clamped[column[held]] = True
        self._particles = particles
        self._free = np.flatnonzero(~clamped)
        self.node_indices = np.stack(np.unravel_index(touched[self._free], grid.size), 1)
        arm = (nodes - relative[:, None]) * (4 / grid.dx)  # 4/dx^2 (x_i - x_p)
        self._value = self._matrix(weights, column, len(touched))
        self._slope = [self._matrix(weights * arm[..., a], column, len(touched)) for a in range(3)]

    def _matrix(self, entries: np.ndarray, column: np.ndarray, count: int) -> sp.csr_matrix:
        row = np.repeat(np.arange(len(entries)), entries.shape[1])
        return sp.csr_matrix((entries.ravel(), (row, column.ravel())), (len(entries), count))[:, self._free]

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

    def compliance(self, young: np.ndarray, load: np.ndarray) -> float:
        """Work f . K^-1 f [J] of loads (P, 3) [N] on the particles."""
        matrix = self.stiffness(young)
        matrix = (matrix + FLOOR * sp.diags(matrix.diagonal() + matrix.diagonal().mean())).tocsc()
        force = (self._value.T @ load).ravel()
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return float(force @ factor.solve(force))


def _stencil(relative: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Node indices (P, 27, 3) and weights (P, 27) of quadratic B-splines at positions in cells (P, 3)."""
    offset = relative - base
    weight = np.stack([0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1) ** 2, 0.5 * (offset - 0.5) ** 2], 1)
    steps = np.array(list(np.ndindex(3, 3, 3)))
    product = weight[:, steps[:, 0], 0] * weight[:, steps[:, 1], 1] * weight[:, steps[:, 2], 2]
    return base[:, None] + steps, product
