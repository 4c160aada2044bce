"""Modes of the simulator's own lattice, and the damping of bodies by them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from benchmarks.bars import Bar, timoshenko_mode
from diffphys_ros.errors import InputError
from diffphys_ros.simulate import Handle, ModalDamping, State, lattice_modes

from .bodies import block, full, masses, simulator

YOUNG, PERIOD_S = 4e4, 1 / 60


def test_frequencies_of_a_bar_are_those_of_theory():
    _, _, omega = lattice_modes(*block((16, 4, 4), dx=0.015, per_cell=1.5), 2e5, count=2)
    assert omega == pytest.approx([timoshenko_mode(Bar(length=0.24, width=0.06), 2).omega] * 2, rel=0.03)
    _, _, omega = lattice_modes(*block((12, 2, 2), dx=0.02, poisson=0.0), YOUNG, count=6)
    axial = math.sqrt(YOUNG / 1000.0) / (4 * 0.24)
    assert np.abs(omega / (2 * math.pi) - axial).min() < 0.03 * axial


def test_shapes_and_gradients_belong_together():
    particles, grid = block((8, 3, 3), dx=0.02)
    shapes, gradients, _ = lattice_modes(particles, grid, YOUNG, count=1)
    x, inner = particles.x_rest, (np.abs(particles.x_rest - [0.08, 0.03, 0.03]) < [0.06, 0.02, 0.02]).all(1)
    for axis in range(3):
        ahead = {tuple(np.round(p / 0.01, 3)): i for i, p in enumerate(x)}
        pairs = np.array([(i, ahead[tuple(np.round((x[i] + 0.01 * np.eye(3)[axis]) / 0.01, 3))]) for i in np.flatnonzero(inner)])
        rise = (shapes[pairs[:, 1], :, 0] - shapes[pairs[:, 0], :, 0]) / 0.01
        mean = gradients[pairs, :, axis, 0].mean(1)
        assert np.abs(rise - mean).max() < 0.05 * np.abs(gradients[..., 0]).max()


def test_a_handle_holds_what_a_clamp_holds():
    clamped, free = (block((6, 2, 2), dx=0.02, clamped=c) for c in (True, False))
    omega = lattice_modes(*clamped, YOUNG, count=4)[2]
    held = lattice_modes(*free, YOUNG, count=4, handle=Handle((-math.inf,) * 3, (0.0, math.inf, math.inf)))[2]
    np.testing.assert_allclose(held, omega, rtol=1e-9)


def test_rigid_motion_of_a_free_body_is_not_damped_and_its_vibration_is():
    sim = simulator(block((6, 3, 3), dx=0.02, clamped=False), substeps=10, period_s=PERIOD_S)
    shapes, gradients, omega = lattice_modes(sim.particles, sim.grid, YOUNG, count=8)
    damping = ModalDamping.of(sim, shapes, gradients, omega)
    assert (omega[:6] < 0.01 * omega[6]).all(), "six rigid modes first"
    spin = sim.tensor(np.array([[0.0, -2.0, 1.0], [2.0, 0.0, -0.5], [-1.0, 0.5, 0.0]]))
    rigid = sim.rest(v=sim.x_rest @ spin.T + 0.3, C=spin.expand(len(sim.volume), 3, 3))
    beta = 0.5 / float(omega[6] ** 2 * PERIOD_S)
    torch.testing.assert_close(damping.kick(rigid, beta).data, rigid.data, rtol=1e-3, atol=1e-4)
    shape, gradient = sim.tensor(shapes[..., 6]), sim.tensor(gradients[..., 6])
    after = damping.kick(sim.rest(v=shape, C=gradient), beta)
    torch.testing.assert_close(after.v, math.exp(-0.5) * shape, rtol=0, atol=1e-9 * float(shape.abs().max()))


def test_an_oscillation_damped_by_the_lattices_modes_decays_at_half_beta_omega_squared():
    sim = simulator(block((10, 2, 2), dx=0.02), substeps=25, period_s=PERIOD_S)
    shapes, gradients, omega = lattice_modes(sim.particles, sim.grid, YOUNG, count=6)
    damping, target, frames = ModalDamping.of(sim, shapes, gradients, omega), 1.0, 150
    beta = 2 * target / float(omega[0]) ** 2
    size = 0.03 / np.abs(shapes[..., 0]).max()
    start = sim.rest(v=size * sim.tensor(shapes[..., 0]), C=size * sim.tensor(gradients[..., 0]))
    weight = masses(sim)[:, None] * sim.tensor(shapes[..., 0])
    left = []
    for rate in (0.0, beta):
        kick = lambda state, rate=rate: damping.kick(state, rate)  # noqa: E731
        with torch.no_grad():
            path = sim.rollout(start, full(sim, YOUNG), full(sim, 0.3), torch.zeros(frames, *sim.x_rest.shape), 0.0, after_frame=kick)
        left.append(_amplitude(sim, path, weight, omega[0]))
    assert -math.log(left[1] / left[0]) / (frames * PERIOD_S) == pytest.approx(target, rel=0.05)


def _amplitude(sim, path: State, weight: torch.Tensor, omega: float) -> float:
    """Share of a mode's amplitude that is left at the end of a path, by the best exponential."""
    place, speed = ((a * weight).sum((1, 2)) for a in (path.x - sim.x_rest, path.v))
    size, count = torch.hypot(omega * place, speed), len(place)
    time = torch.arange(count, dtype=torch.float64)
    slope = torch.linalg.lstsq(torch.stack([torch.ones(count).double(), time], 1), size.log()[:, None]).solution[1]
    return math.exp(float(slope) * (count - 1))


def test_more_modes_than_coordinates_are_refused_in_a_sentence():
    with pytest.raises(InputError, match="ask for fewer"):
        lattice_modes(*block((2, 2, 2), dx=0.02), YOUNG, count=4000)
