"""Eigenmodes of a body as the simulator's own lattice has them at rest: for the damping of bodies whose modes nobody gave.

Small strains about x_rest. The stiffness is that of the substep's stress divergence, the mass that of the particles'
velocities: lumped nodal masses would add soft spurious modes of nodes that particles hardly touch. With fewer than 1.5
particles per cell and axis the lattice has motions that strain no particle; they come out with frequencies near zero.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh

from ..errors import InputError
from ..hooke import lame
from ..types import Grid, Particles
from .borders import Handle

STRAINS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
FAINT = 1e-9  # share of mass and stiffness given to motions of nodes that no particle sees, so that they are fast, not arbitrary


def lattice_modes(
    particles: Particles, grid: Grid, young: np.ndarray | float, *, count: int, handle: Handle | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The lowest `count` modes for Young's modulus (P,) [Pa], clamp and handle held: shapes (P, 3, count) and their
    gradients (P, 3, 3, count) [1/m] at the particles, angular frequencies [rad/s]; rigid modes have none. Raises InputError."""
    value, slope = _transfer(particles.x_rest, grid)
    held = _held(grid, handle)
    nodal_mass = value.T @ particles.mass
    free = np.flatnonzero((nodal_mass > 0) & ~held)
    value, slope = value[:, free], [s[:, free] for s in slope]
    if not 0 < count < 3 * len(free) - 1:
        raise InputError(f"lattice_modes: {count} modes of {3 * len(free)} free coordinates; ask for fewer, at least one")
    stiffness, inertia = _stiffness(particles, slope, young), _inertia(particles, value)
    pace = stiffness.diagonal().mean() / inertia.diagonal().mean()  # [1/s^2] of the lattice's fastest motions
    faint = FAINT * sparse.diags(np.repeat(nodal_mass[free], 3))
    omega2, nodal = eigsh(stiffness + pace * faint, count, inertia + faint, sigma=-1e-6 * pace, v0=np.ones(stiffness.shape[0]))
    nodal = nodal.reshape(len(free), 3, count)
    shapes = np.stack([value @ nodal[:, a] for a in range(3)], 1)
    gradients = np.stack([np.stack([s @ nodal[:, a] for s in slope], 1) for a in range(3)], 1)
    return shapes, gradients, np.sqrt(np.maximum(omega2, 0.0))


def _transfer(x: np.ndarray, grid: Grid) -> tuple[sparse.csr_matrix, list[sparse.csr_matrix]]:
    """Matrices (P, nodes) from nodal values to values at x (P, 3), and to APIC's gradients along each axis [1/m]."""
    cells = (x - grid.origin) / grid.dx
    base = np.floor(cells - 0.5).astype(int)
    offsets = np.array(list(itertools.product(range(3), repeat=3)))
    arm = (base[:, None] + offsets) - cells[:, None]
    distance = np.abs(arm)
    weight = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * (1.5 - distance) ** 2).prod(-1)
    column = np.ravel_multi_index(tuple(np.moveaxis(base[:, None] + offsets, -1, 0)), grid.size)
    row = np.repeat(np.arange(len(x)), len(offsets))

    def matrix(entries: np.ndarray) -> sparse.csr_matrix:
        return sparse.csr_matrix((entries.ravel(), (row, column.ravel())), shape=(len(x), int(np.prod(grid.size))))

    return matrix(weight), [matrix(4 / grid.dx * weight * arm[..., a]) for a in range(3)]


def _held(grid: Grid, handle: Handle | None) -> np.ndarray:
    """Which nodes do not move, shape (nodes,)."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grid.size), indexing="ij"), -1).reshape(-1, 3)
    held = index[:, 0] <= grid.clamp_index
    return held if handle is None else held | handle.holds(grid.origin + grid.dx * index, dx=grid.dx)


def _stiffness(particles: Particles, slope: list[sparse.csr_matrix], young: np.ndarray | float) -> sparse.csr_matrix:
    """Of Hooke's law: 2 mu |eps|^2 + lam tr(eps)^2 is twice the energy density."""
    lam, mu = lame(young, particles.poisson)
    zero = sparse.csr_matrix(slope[0].shape)
    total = sparse.csr_matrix((3 * zero.shape[1],) * 2)
    for a, b in STRAINS:
        rows = [zero, zero, zero]
        rows[a] = rows[a] + slope[b] / 2
        rows[b] = rows[b] + slope[a] / 2
        strain = _interleave(rows)
        total = total + strain.T @ sparse.diags((2 if a == b else 4) * mu * particles.volume) @ strain
    dilation = _interleave(slope)
    return (total + dilation.T @ sparse.diags(lam * particles.volume) @ dilation).tocsc()


def _inertia(particles: Particles, value: sparse.csr_matrix) -> sparse.csr_matrix:
    return sparse.kron(value.T @ sparse.diags(particles.mass) @ value, sparse.eye(3)).tocsc()


def _interleave(rows: list[sparse.csr_matrix]) -> sparse.csr_matrix:
    """Columns node by node: x, y, z."""
    nodes = rows[0].shape[1]
    order = np.arange(3 * nodes).reshape(3, nodes).T.ravel()
    return sparse.hstack(rows).tocsc()[:, order]
