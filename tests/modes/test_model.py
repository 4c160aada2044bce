"""The reduced model: interpolation, exact response, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from diffphys_ros import store
from diffphys_ros.damping import Damping
from diffphys_ros.elements.mesh import solid_mesh
from diffphys_ros.modes import interpolation
from diffphys_ros.modes.detuned import Detuned
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.modes.response import Step
from tests.made_bar import BETA, FRAMES, PERIOD_S, YOUNG, bar, gust, modes_of, motion


@pytest.fixture(scope="module")
def modal() -> ModalModel:
    return modes_of(bar(pitch=5e-4), YOUNG)


def quadratic(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = points.T
    value = 1 + x - 2 * y + 3 * x * y - z**2 + 0.5 * x**2
    return value, np.stack([1 + 3 * y + x, -2 + 3 * x, -2 * z], 1)


def test_quadratic_fields_are_reproduced_with_their_gradients(modal):
    value, _gradient = quadratic(modal.nodes)
    rng = np.random.default_rng(0)
    points = rng.uniform(0.02, 0.98, (200, 3)) * np.ptp(modal.nodes, axis=0) + modal.nodes.min(0)
    found, slope = interpolation.evaluate(modal.nodes, modal.tets, value, points)
    expected, expected_slope = quadratic(points)
    assert found == pytest.approx(expected, abs=1e-6)
    assert slope == pytest.approx(expected_slope, abs=1e-3)


def test_linear_fields_continue_outside_the_mesh(modal):
    points = modal.nodes[::7] * 1.3 + (0.02, 0.0, 0.0)
    field = modal.nodes @ (1.0, -2.0, 0.5)
    assert interpolation.evaluate(modal.nodes, modal.tets, field, points)[0] == pytest.approx(points @ (1.0, -2.0, 0.5), abs=1e-9)


def test_quadrature_sums_to_the_volume():
    body = bar()
    mesh = solid_mesh(body)
    volume = interpolation.quadrature(mesh.vertices, np.pad(mesh.tets, ((0, 0), (0, 6))))[1]
    assert volume.sum() == pytest.approx(body.volume_m3, rel=1e-3)


def test_at_quadrature_points_fields_have_the_values_that_a_search_finds_there(modal):
    field = np.random.default_rng(0).normal(size=(len(modal.nodes), 3, 2))
    points = interpolation.quadrature(modal.nodes, modal.tets)[0]
    found, expected = interpolation.at_quadrature(modal.nodes, modal.tets, field), interpolation.evaluate(modal.nodes, modal.tets, field, points)
    assert all(mine == pytest.approx(theirs, rel=1e-9, abs=1e-6) for mine, theirs in zip(found, expected, strict=True))


def test_the_basis_is_mass_orthonormal(modal):
    points, volume, _ = interpolation.quadrature(modal.nodes, modal.tets)
    value = modal.evaluate(points)[0][..., :3]
    assert np.einsum("m,mca,mcb->ab", 600.0 * volume, value, value) == pytest.approx(np.eye(3), abs=0.01)


@pytest.mark.parametrize(("omega", "decay"), [(20.0, 1.5), (20.0, 35.0), (20.0, 20.0), (800.0, 700.0)])
def test_frame_steps_agree_with_a_fine_integration(omega, decay):
    load, period = np.array([3.0, -1.0, 0.0, 0.0, 2.0]), 1 / 30
    step = Step.of(np.array([omega**2]), np.array([decay]), period)
    state, exact = np.array([[0.02], [0.3]]), np.array([0.02, 0.3])
    for p in load:
        state = step(state, p)
        exact = solve_ivp(lambda t, s, p=p: [s[1], p - 2 * decay * s[1] - omega**2 * s[0]], (0, period), exact, rtol=1e-10, atol=1e-13).y[:, -1]
    assert state[:, 0] == pytest.approx(exact, rel=1e-6, abs=1e-9)


def test_very_stiff_modes_follow_the_load_without_overflow():
    step = Step.of(np.array([1e12]), np.array([1e9]), 1 / 30)
    assert step(np.zeros((2, 1)), 1.0)[0] == pytest.approx(1e-12, rel=1e-3)


def test_a_constant_load_ends_in_the_static_displacement(modal):
    force = np.tile([0.0, 50.0, 0.0], (400, 1))
    load = force @ modal.footprint_load().T
    q = modal.respond(YOUNG, damping=Damping(8.0, 0.0), load=load, period_s=PERIOD_S)
    assert q[-1] == pytest.approx(np.linalg.solve(modal.matrix(YOUNG), load[0]), rel=1e-3, abs=1e-9)


def test_the_jacobian_agrees_with_differences_of_the_response(modal):
    rng = np.random.default_rng(1)
    force, frames = gust(), np.arange(2, 12)
    start = {"initial_displacement": 1e-3 * rng.standard_normal(modal.modes), "initial_velocity": 1e-2 * rng.standard_normal(modal.modes)}
    footprint = modal.footprint_load()
    physics = {"damping": Damping(0.2, BETA), "period_s": PERIOD_S}
    found = modal.jacobian(YOUNG, footprint=footprint, force=force, frames=frames, initial_modes=2, **physics, **start)

    def response(z: np.ndarray) -> np.ndarray:
        moved = force.copy()
        moved[frames] += z[4:34].reshape(-1, 3)
        begun = {name: value + np.pad(z[k : k + 2], (0, modal.modes - 2)) for (name, value), k in zip(start.items(), (34, 36), strict=True)}
        changed = dict(physics, damping=Damping(0.2 + z[2], BETA + z[3]))
        return modal.respond(YOUNG * np.exp(z[:2]), load=moved @ footprint.T, **changed, **begun)

    steps = np.r_[1e-3, 1e-3, 1e-2, 1e-5, np.full(30, 1.0), np.full(4, 1e-3)]
    for i, h in enumerate(steps):
        shift = h * np.eye(38)[i]
        difference = (response(shift) - response(-shift)) / (2 * h)
        assert found[:, :, i] == pytest.approx(difference, rel=2e-3, abs=2e-4 * np.abs(difference).max() + 1e-15), i


def test_track_derivatives_are_those_of_the_points(modal):
    points, force = np.array([[0.29, 0.02, 0.06], [0.1, -0.03, -0.05]]), gust()
    arguments = {"damping": Damping(0.0, BETA), "footprint": modal.footprint_load(), "force": force, "frames": np.arange(3, 11), "period_s": PERIOD_S}
    derivative = modal.track_jacobian(points, YOUNG, **arguments)
    assert derivative.shape == (FRAMES, 2, 3, 2 + 2 + 24)
    stiffer = np.einsum("mcr,tr->tmc", modal.evaluate(points)[0], motion(modal, YOUNG * (1.001, 1.0), force) - motion(modal, YOUNG / (1.001, 1.0), force))
    assert derivative[..., 0] == pytest.approx(stiffer / (2 * np.log(1.001)), abs=2e-3 * np.abs(derivative[..., 0]).max())


def test_retuning_moves_the_leading_frequencies_alone(modal):
    tuned = modal.retuned(YOUNG, np.array([0.02, -0.01]))
    assert tuned.frequencies(YOUNG)[:3] / modal.frequencies(YOUNG)[:3] == pytest.approx([np.exp(0.02), np.exp(-0.01), 1.0], rel=1e-9)


def test_retuning_couples_modes_of_nearly_one_frequency():
    square, young = modes_of(bar(thickness=0.1, edges=()), YOUNG[:1]), YOUNG[:1]
    before, shapes = square.eigen(young)
    detune, coupling = np.array([0.01, 0.0]), np.array([0.004])
    wanted, turned = Detuned.of(before, detune, coupling).leading(before, shapes)
    assert wanted[1] / wanted[0] > 1.01 * before[1] / before[0]
    squares, found = square.retuned(young, detune, coupling).eigen(young)
    assert squares == pytest.approx(np.sort(wanted), rel=1e-9)
    np.testing.assert_allclose(np.abs(found.T @ turned[:, np.argsort(wanted)]), np.eye(len(squares)), atol=1e-6)


def test_another_basis_describes_the_same_motion(modal):
    other = modal.rotated(YOUNG * (1.0, 0.6))
    points = np.array([[0.28, 0.01, 0.03]])
    paths = [np.einsum("mcr,tr->tmc", m.evaluate(points)[0], motion(m, YOUNG, gust())) for m in (modal, other)]
    assert paths[0] == pytest.approx(paths[1], abs=1e-12)


def test_the_model_survives_the_disk(modal, tmp_path):
    again = store.load(store.save(tmp_path / "modal.npz", modal), (ModalModel,))
    assert np.array_equal(again.stiffness, modal.stiffness)
    assert again.frequencies(YOUNG) == pytest.approx(modal.frequencies(YOUNG), abs=0)
