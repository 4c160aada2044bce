"""Apparent stiffness of the solver's grid."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.modes import apparent_stiffness
from diffphys_ros.modes.lattice import Lattice
from diffphys_ros.types import Grid, Particles

from .made import bar, modes_of

LENGTH, SIDE, YOUNG = 0.3, 0.1, np.array([1e5])


def lattice_of(cells: int, per_cell: int = 2) -> tuple[Particles, Grid]:
    """Particles of a square bar and two cells of ghosts behind the clamp, on a grid that fits it."""
    dx = SIDE / cells
    spacing = dx / per_cell
    x = np.arange(-2 * dx, LENGTH, spacing) + spacing / 2
    across = np.arange(-SIDE / 2, SIDE / 2 - 1e-9, spacing) + spacing / 2
    points = np.stack(np.meshgrid(x, across, across, indexing="ij"), -1).reshape(-1, 3)
    count = len(points)
    particles = Particles(points, np.full(count, spacing**3), np.ones(count, int), np.full(count, 600.0), np.full(count, 0.3), points[:, 0] < 0)
    origin = np.array([-5 * dx, -SIDE / 2 - 3 * dx, -SIDE / 2 - 3 * dx])
    return particles, Grid(origin, dx, (round(LENGTH / dx) + 9, cells + 7, cells + 7), 5)


@pytest.fixture(scope="module")
def ratios() -> list[float]:
    body = bar(length=LENGTH, height=SIDE, thickness=SIDE, edges=())
    modal = modes_of(body, YOUNG)
    return [apparent_stiffness(*lattice_of(cells), body, YOUNG, modal) for cells in (2, 4, 8)]


def test_the_grid_is_soft_and_approaches_the_elements_under_refinement(ratios):
    error = 1 - np.array(ratios)
    assert (error > 0).all()
    assert error[1] < 0.6 * error[0]
    assert error[2] < 0.6 * error[1]
    assert error[2] < 0.05


def test_the_ratio_does_not_depend_on_the_modulus():
    body = bar(length=LENGTH, height=SIDE, thickness=SIDE, edges=())
    modal = modes_of(body, YOUNG)
    grid = lattice_of(3)
    assert apparent_stiffness(*grid, body, 7 * YOUNG, modal) == pytest.approx(apparent_stiffness(*grid, body, YOUNG, modal), rel=1e-6)


def test_a_body_without_clamp_needs_no_correction():
    body = bar(length=LENGTH, height=SIDE, thickness=SIDE, edges=(), clamped=False)
    assert apparent_stiffness(*lattice_of(2), body, YOUNG, modes_of(bar(edges=()), YOUNG)) == 1.0


def test_the_stiffness_is_symmetric_and_knows_uniform_strain():
    particles, grid = lattice_of(3)
    lattice = Lattice(particles, Grid(grid.origin, grid.dx, grid.size, -1))
    matrix = lattice.stiffness(np.full(len(particles.volume), YOUNG[0]))
    assert abs(matrix - matrix.T).max() < 1e-9 * abs(matrix).max()
    stretch = np.array([[1e-3, 0, 0], [0, 0, 0], [0, 0, 0]])
    nodes = grid.origin + grid.dx * lattice.node_indices
    moved = (nodes @ stretch.T).ravel()
    energy = 0.5 * moved @ (matrix @ moved)
    longitudinal = YOUNG[0] * 0.7 / (1.3 * 0.4)
    assert energy == pytest.approx(0.5 * longitudinal * 1e-6 * particles.volume.sum(), rel=1e-9)
