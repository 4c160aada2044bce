"""The solver's apparent stiffness: what a grid adds to a fitted modulus, and its correction."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize_scalar

from benchmarks.bars import Bar, Lattice, fitted, kinds_of
from diffphys_ros.inverse import forward
from diffphys_ros.inverse.apparent_stiffness import LEFT_OVER, Apparent, elastic_modes, measure_apparent, motion_share, swing_ratios, swings
from diffphys_ros.inverse.resolution import GRIDS
from diffphys_ros.modes import ModalModel
from diffphys_ros.particles import bind
from diffphys_ros.simulate import ModalDamping, Simulator, substeps_per_frame

BAR = Bar(length=0.24)
FRAMES_PER_PERIOD, FRAMES, AMPLITUDE = 16, 24, 0.05  # of the length: as large as a fit's motion
SURFACE = np.stack(np.meshgrid(np.linspace(0.05, 0.23, 7), [-0.04, 0.0, 0.04], [-0.029, 0.029], indexing="ij"), -1).reshape(-1, 3)


@pytest.fixture(scope="module")
def modal() -> ModalModel:
    return BAR.modal()


def simulated(lattice: Lattice, modal: ModalModel, mode: int, young: float) -> np.ndarray:
    """Displacements (FRAMES + 1, M, 3) of points on the surface after a push in a mode that does not depend on `young`."""
    particles, grid = lattice
    omega, value, gradient = elastic_modes(modal, np.array([BAR.young]), particles, np.array([mode]))
    tip = np.abs(modal.evaluate(SURFACE)[0] @ np.linalg.eigh(modal.elastic(np.array([BAR.young])))[1][:, [mode]]).max()
    push = AMPLITUDE * BAR.length * omega / tip
    period_s = float(2 * np.pi / omega[0] / FRAMES_PER_PERIOD)
    substeps = substeps_per_frame(1.3 * BAR.young, BAR.poisson, BAR.density, dx=grid.dx, period_s=period_s)
    simulator = Simulator(particles, grid, substeps=substeps, period_s=period_s)
    start = simulator.rest(v=simulator.tensor(value @ push), C=simulator.tensor(gradient @ push))
    with torch.no_grad():
        force = torch.zeros(FRAMES, *simulator.x_rest.shape)
        path = simulator.rollout(start, simulator.tensor(young), simulator.tensor(BAR.poisson), force, 0.0)
    return bind(SURFACE, particles.x_rest).apply((path.x - path.x[:1]).double().numpy())


def fit(lattice: Lattice, modal: ModalModel, mode: int, seen: np.ndarray) -> float:
    """Young's modulus that explains the displacements best, over the true one."""
    misfit = lambda log_e: float(((simulated(lattice, modal, mode, BAR.young * np.exp(log_e)) - seen) ** 2).sum())  # noqa: E731
    return float(np.exp(minimize_scalar(misfit, bounds=(-0.3, 0.3), method="bounded", options={"xatol": 1e-3}).x))


@pytest.mark.parametrize(
    ("kind", "lattice", "bound"),
    [
        ("bend_z", fitted(BAR, 3, 1.5, offset=-0.5), LEFT_OVER),
        ("bend_y", fitted(BAR, 3, 1.0), LEFT_OVER),
        ("twist", fitted(BAR, 3, 1.5), 0.035),  # the finer grid twists 0.028 too softly itself
    ],
    ids=["clamp off the grid", "one particle per cell", "twisting"],
)
def test_a_fit_to_a_truth_on_a_grid_twice_as_fine_ends_nearer_with_the_calibration(modal, kind, lattice, bound):
    mode, young = kinds_of(modal, BAR)[kind], np.array([BAR.young])
    plain = fit(lattice, modal, mode, simulated(fitted(BAR, 6, 2.0), modal, mode, BAR.young))
    ratio = swing_ratios(*lattice, young, *elastic_modes(modal, young, lattice[0], np.array([mode])))
    before, after = abs(np.log10(plain)), abs(np.log10(plain * ratio[0]))
    assert before > 0.02, "the grid must be off for this to mean anything"
    assert after < 0.6 * before
    assert after < bound


def test_a_thin_bar_is_as_stiff_as_a_thick_one_on_as_many_cells():
    """It swings slowly: what a substep strains it is lost where numbers are rounded to single precision."""
    thin = Bar(length=0.48, width=0.02, thickness=0.02)
    lattice, modal, young = fitted(thin, 3, 1.5), thin.modal(), np.array([thin.young])
    assert measure_apparent(*lattice, modal, young, np.array([1.0])).value == pytest.approx(1.0, abs=0.03)


def test_a_swing_is_measured_whatever_its_size(modal):
    """Modal coordinates of a light body are small numbers; they must not pass for a fit that has ended."""
    young = np.array([BAR.young])
    lattice, light = (fitted(bar, 2.7, 1.5) for bar in (BAR, replace(BAR, density=1e-3 * BAR.density)))
    omega, value, gradient = elastic_modes(modal, young, lattice[0], np.array([0]))
    heavy_ratio = swing_ratios(*lattice, young, omega, value, gradient)
    light_ratio = swing_ratios(*light, young, omega * np.sqrt(1e3), value * np.sqrt(1e3), gradient * np.sqrt(1e3))
    off_ratio = swing_ratios(*lattice, young, 1.1 * omega, value, gradient)
    assert light_ratio == pytest.approx(heavy_ratio, rel=2e-3)
    assert off_ratio == pytest.approx(heavy_ratio / 1.21, rel=2e-3)


def test_modes_that_disagree_raise_the_expected_error():
    share = np.array([0.5, 0.5])
    agree, differ = (Apparent(np.array(ratio), share, np.zeros(2)) for ratio in ([0.9, 0.9], [0.9, 1.0]))
    assert agree.expected_log10_error == pytest.approx(LEFT_OVER)
    assert differ.expected_log10_error == pytest.approx(np.hypot(LEFT_OVER, np.log10(1 / 0.9) / 2))
    assert differ.value == pytest.approx(np.sqrt(0.9))


def test_the_calibration_of_a_body_is_that_of_its_leading_modes(modal):
    lattice, young = fitted(BAR, 3, 1.5), np.array([BAR.young])
    found = measure_apparent(*lattice, modal, young, np.array([0.7, 0.3]))
    each = [swing_ratios(*lattice, young, *elastic_modes(modal, young, lattice[0], np.array([k])))[0] for k in (0, 1)]
    assert found.ratio == pytest.approx(each, rel=3e-3)
    assert found.value == pytest.approx(each[0] ** 0.7 * each[1] ** 0.3, rel=3e-3)


def test_start_values_that_do_not_move_count_as_the_lowest_mode(modal):
    np.testing.assert_array_equal(motion_share(modal, np.array([BAR.young]), np.zeros((6, modal.modes))), [1.0])


def test_what_the_lattice_takes_of_a_swing_is_measured_and_given_back(modal):
    """A bar of three cells loses a hundredth of its swing in a period to transfers between particles and grid."""
    (particles, grid), young = fitted(BAR, 3, 2.0), np.array([BAR.young])
    omega, value, gradient = elastic_modes(modal, young, particles, np.array([0]))
    loss = swings(particles, grid, young, omega, value, gradient)[1]
    period_s = float(2 * np.pi / omega[0])
    substeps = substeps_per_frame(BAR.young, BAR.poisson, BAR.density, dx=grid.dx, period_s=period_s / FRAMES_PER_PERIOD)
    simulator = Simulator(particles, grid, substeps=substeps, period_s=period_s / FRAMES_PER_PERIOD)
    tensor, mass, push = simulator.tensor, particles.mass, 0.01 * BAR.length * omega / np.abs(value).max()
    start = simulator.rest(v=tensor(value @ push), C=tensor(gradient @ push))
    force, left = torch.zeros(4 * FRAMES_PER_PERIOD, *simulator.x_rest.shape), []
    for given_back in (0.0, loss * substeps * FRAMES_PER_PERIOD / period_s):
        damping = ModalDamping.of(simulator, value, gradient, omega, np.zeros(1) + given_back)
        with torch.no_grad():
            path = simulator.rollout(start, tensor(BAR.young), tensor(BAR.poisson), force, 0.0, after_frame=lambda s, d=damping: d.kick(s, 0.0))
        swing = np.einsum("pc,tpc->t", mass[:, None] * value[..., 0], (path.x - path.x[:1]).double().numpy())
        first, last = (np.ptp(swing[k : k + FRAMES_PER_PERIOD]) for k in (0, 3 * FRAMES_PER_PERIOD))
        left.append(last / first)
    assert left[0] < 0.985, "the lattice must take something for this to mean anything"
    assert left[1] == pytest.approx(1.0, abs=0.15 * (1 - left[0]))


@pytest.mark.parametrize(("cells", "per_cell"), [GRIDS[-1], (3, 1.6)])
def test_a_grid_that_may_be_chosen_swings_back_as_far_as_it_swung_though_it_is_far(cells: float, per_cell: float) -> None:
    """.3 of its length. With 1.5 particles per cell and axis, which do not keep their weights, it comes back to .7 and .8 of it."""
    slab = Bar(length=0.3, width=0.06, thickness=0.03)
    (particles, grid), modal, young = fitted(slab, cells, per_cell, reach_m=0.15), slab.modal(), np.array([slab.young])
    omega, value, gradient = elastic_modes(modal, young, particles, np.array([0]))
    period_s = float(2 * np.pi / omega[0] / FRAMES_PER_PERIOD)
    substeps = substeps_per_frame(slab.young, slab.poisson, slab.density, dx=grid.dx, period_s=period_s)
    simulator, push = Simulator(particles, grid, substeps=substeps, period_s=period_s), 0.3 * slab.length * omega / np.abs(value).max()
    tensor, force = simulator.tensor, torch.zeros(FRAMES_PER_PERIOD, *simulator.x_rest.shape)
    with torch.no_grad():
        path = simulator.rollout(simulator.rest(v=tensor(value @ push), C=tensor(gradient @ push)), tensor(slab.young), tensor(slab.poisson), force, 0.0)
    swing = np.einsum("pc,tpc->t", particles.mass[:, None] * value[..., 0], (path.x - path.x[:1]).double().numpy())
    assert -swing.min() / swing.max() == pytest.approx(1.0, abs=0.03)


def test_elements_that_nothing_holds_are_not_let_swing(monkeypatch, modal):
    """A clamp that holds no element leaves a mode that takes months."""
    loose = SimpleNamespace(body=SimpleNamespace(clamped=True), modal=replace(modal, stiffness=0 * modal.stiffness), start=SimpleNamespace(young=np.array([BAR.young])))
    monkeypatch.setattr(forward, "measure_apparent", lambda *_, **__: pytest.fail("was measured"))
    value, error, loss = forward._apparent(loose, SimpleNamespace(simulates=True), None, None, "cpu")
    assert (value, error, len(loss)) == (1.0, forward.UNMEASURED, 0)
