"""Claims about the second solid that makes truths: its derivative, its energy, its frequency, and what turning does to it."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from tests.script import loaded

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
LENGTH_M, SIDE_M, YOUNG_PA, DENSITY = 0.4, 0.04, 2e5, 400.0


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return loaded(BENCHMARKS / "hyperelastic.py")


def beam(module: ModuleType, cells: int = 6, damping_s: float = 0.0):
    """A bar along x."""
    filled, each = np.array([(i, 0, 0) for i in range(cells)]), np.ones(cells)
    size = np.array([LENGTH_M / cells, SIDE_M, SIDE_M])
    return module.Solid(filled, size, np.zeros(3), YOUNG_PA * each, 0.3 * each, DENSITY * each, stiffness_damping=damping_s)


def test_the_matrix_is_the_derivative_of_the_forces(module) -> None:
    solid, rng, step = beam(module, 2, damping_s=3e-3), np.random.default_rng(0), module.Step(0.5, 100.0)
    u, v, d = (scale * rng.standard_normal(solid.nodes.shape) for scale in (2e-3, 0.1, 1.0))
    ahead, behind = (solid.force(u + s * step.moved * d, v + s * step.sped * d)[0] for s in (1e-7, -1e-7))
    assert solid.force(u, v, step)[1] @ d.ravel() == pytest.approx((ahead - behind) / 2e-7, rel=1e-6, abs=1e-6 * np.abs(ahead).max() / 1e-7)


def test_forces_are_the_slope_of_the_energy(module) -> None:
    solid, rng = beam(module, 2), np.random.default_rng(1)
    u, d = 2e-3 * rng.standard_normal(solid.nodes.shape), rng.standard_normal(solid.nodes.shape)
    slope = (solid.energy(u + 1e-7 * d) - solid.energy(u - 1e-7 * d)) / 2e-7
    assert float(solid.force(u, np.zeros_like(u))[0] @ d.ravel()) == pytest.approx(slope, rel=1e-6)


def test_a_body_that_turns_is_neither_strained_nor_braked(module) -> None:
    solid = beam(module, 2, damping_s=3e-3)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    u, v = solid.nodes @ turn.T - solid.nodes, np.cross([0.0, 0.0, 5.0], solid.nodes @ turn.T)
    assert np.abs(solid.force(u, v)[0]).max() < 1e-10


def test_a_slender_bar_swings_at_the_beam_theorys_frequency(module) -> None:
    solid = beam(module, 8)
    dofs = module.Marcher(solid, solid.nodes[:, 0] > 1e-9)._dofs
    still = np.zeros_like(solid.nodes)
    stiffness = solid.force(still, still, module.Step(1.0, 0.0))[1][dofs][:, dofs].tocsc()
    hz = np.sqrt(eigsh(stiffness, k=1, M=solid.mass[dofs][:, dofs].tocsc(), sigma=0)[0][0]) / (2 * np.pi)
    assert hz == pytest.approx(1.8751**2 / (2 * np.pi) * np.sqrt(YOUNG_PA * SIDE_M**2 / 12 / DENSITY) / LENGTH_M**2, rel=0.01)


def test_a_body_let_go_keeps_its_energy(module) -> None:
    solid = beam(module, 4)
    march, u = module.Marcher(solid, solid.nodes[:, 0] > 1e-9), None
    u = march.equilibrium(solid.load(np.tile([0.0, 0.0, 300.0], (len(solid.nodes), 1))))
    v, none = np.zeros_like(u), np.zeros(u.size)
    begun, lowest = solid.energy(u), np.inf
    for _ in range(60):
        u, v = march.stepped(u, v, none, 1 / 240)
        lowest = min(lowest, solid.energy(u))
    assert lowest < 0.1 * begun  # it swings
    assert solid.energy(u) + 0.5 * v.ravel() @ (solid.mass @ v.ravel()) == pytest.approx(begun, rel=1e-3)


@pytest.mark.parametrize("newtons_per_m3", [1e-12, 1e-3])
def test_a_body_at_rest_takes_the_least_push(module, newtons_per_m3: float) -> None:
    solid = beam(module, 4)
    march, still = module.Marcher(solid, solid.nodes[:, 0] > 1e-9), np.zeros_like(solid.nodes)
    u, v = march.stepped(still, still, solid.load(np.full_like(solid.nodes, newtons_per_m3)), 1 / 240)
    assert np.abs(u).max() < 1e-6 * newtons_per_m3 + 1e-12
    assert np.isfinite(v).all()


def test_the_vertices_of_a_scene_are_nodes_of_its_finer_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(BENCHMARKS)
    second_truth = loaded(BENCHMARKS / "second_truth.py")
    size, origin = np.array([0.02, 0.03, 0.04]), np.array([-0.01, 0.0, 0.0])
    filled = np.ones((1, 1, 2), bool)
    vertices = origin + np.array(list(np.ndindex(3, 3, 5))) * size / 2
    mesh = SimpleNamespace(filled=filled, cell_part=np.arange(2).reshape(1, 1, 2), cell_size=size, origin=origin, vertices=vertices)
    scene = SimpleNamespace(mesh=mesh, young=[1e5, 2e5], poisson=[0.3, 0.4], density=[500.0, 700.0], mass_damping=0.1, stiffness_damping=1e-3)
    solid, number = second_truth.solid_of(scene, 2)
    assert solid.nodes[number] == pytest.approx(vertices)
    assert (solid.young.tolist(), len(solid.cells)) == ([1e5] * 8 + [2e5] * 8, 16)
    assert solid.volume().sum() == pytest.approx(2 * np.prod(size))
    assert solid.mass.sum() / 3 == pytest.approx(1200.0 * np.prod(size))
