"""Stiffness-proportional damping, split from the substeps."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import ModalDamping

from .bodies import block, full, masses, simulator

LENGTH, YOUNG, PERIOD_S = 0.24, 4e4, 1 / 60


def column(substeps: int = 24):
    """A bar whose Poisson's ratio is zero, and its first two axial modes sin((2 m - 1) pi x / 2 L)."""
    sim = simulator(block((12, 2, 2), dx=0.02, poisson=0.0), substeps=substeps, period_s=PERIOD_S)
    wave = torch.tensor([1.0, 3.0], dtype=torch.float64) * math.pi / (2 * LENGTH)
    shapes, gradients = torch.zeros(len(sim.volume), 3, 2).double(), torch.zeros(len(sim.volume), 3, 3, 2).double()
    shapes[:, 0] = torch.sin(sim.x_rest[:, :1] * wave)
    gradients[:, 0, 0] = wave * torch.cos(sim.x_rest[:, :1] * wave)
    frequencies = wave * math.sqrt(YOUNG / 1000.0)
    return sim, shapes, gradients, frequencies, ModalDamping(shapes, gradients, frequencies, masses(sim), period_s=PERIOD_S)


def test_a_kick_shrinks_each_mode_by_its_own_rate_and_nothing_else():
    sim, shapes, gradients, frequencies, damping = column()
    sideways = torch.zeros_like(sim.x_rest)
    sideways[:, 1] = 0.4
    state = sim.rest(v=shapes @ torch.tensor([0.3, -0.2]).double() + sideways, C=gradients @ torch.tensor([0.3, -0.2]).double())
    after = damping.kick(state, 2e-3)
    left = torch.tensor([0.3, -0.2]).double() * torch.exp(-2e-3 * frequencies**2 * PERIOD_S)
    torch.testing.assert_close(after.v, shapes @ left + sideways, rtol=0, atol=1e-12)
    torch.testing.assert_close(after.C, gradients @ left, rtol=0, atol=1e-10)
    assert torch.equal(after.x, state.x)
    assert torch.equal(after.F, state.F)


def test_a_kick_is_stable_for_any_damping():
    sim, shapes, _, _, damping = column()
    after = damping.kick(sim.rest(v=shapes[..., 0]), 1e6)
    assert after.v.abs().max() < 1e-12


@pytest.mark.parametrize("substeps", [24, 48])
def test_an_oscillation_decays_at_half_beta_omega_squared_whatever_the_substeps(substeps):
    sim, shapes, gradients, frequencies, damping = column(substeps)
    beta = 2 * 1.2 / float(frequencies[0]) ** 2  # amplitude decays at 1.2 1/s
    start = sim.rest(v=0.02 * shapes[..., 0], C=0.02 * gradients[..., 0])
    frames = 40
    peaks = []
    for rate in (0.0, beta):
        kick = lambda state, rate=rate: damping.kick(state, rate)  # noqa: E731
        with torch.no_grad():
            path = sim.rollout(start, full(sim, YOUNG), full(sim, 0.0), torch.zeros(frames, *sim.x_rest.shape), 0.0, after_frame=kick)
        displacement = torch.einsum("tpa,pa->t", path.x - sim.x_rest, shapes[..., 0] * masses(sim)[:, None])
        rate_of = torch.einsum("tpa,pa->t", path.v, shapes[..., 0] * masses(sim)[:, None]) / frequencies[0]
        amplitude = torch.hypot(displacement, rate_of)
        peaks.append(float(amplitude[-8:].mean() / amplitude[1:9].mean()))
    measured = -math.log(peaks[1] / peaks[0]) / ((frames - 8) * PERIOD_S)
    assert measured == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_a_retuned_mode_swings_as_much_faster_and_the_other_as_before(factor: float) -> None:
    sim, shapes, gradients, frequencies, _ = column()
    change = torch.diag(torch.stack([(factor**2 - 1) * frequencies[0] ** 2, torch.zeros(()).double()]))
    hz = []
    for retuning in (None, change):
        damping = ModalDamping(shapes, gradients, frequencies, masses(sim), period_s=PERIOD_S, retuning=retuning, rest=sim.x_rest)
        speed = torch.tensor([0.02, 0.01]).double()
        start = sim.rest(v=shapes @ speed, C=gradients @ speed)
        kick = lambda state, damping=damping: damping.kick(state, 0.0)  # noqa: E731
        with torch.no_grad():
            path = sim.rollout(start, full(sim, YOUNG), full(sim, 0.0), torch.zeros(60, *sim.x_rest.shape), 0.0, after_frame=kick)
        weighted = shapes * masses(sim)[:, None, None]
        amplitude = torch.einsum("tpa,pak->tk", path.x - sim.x_rest, weighted)
        hz.append([frequency(amplitude[:, k].numpy()) for k in range(2)])
    assert hz[1][0] / hz[0][0] == pytest.approx(factor, rel=4e-3)
    assert hz[1][1] / hz[0][1] == pytest.approx(1.0, rel=4e-3)


def frequency(motion: np.ndarray) -> float:
    """Of a swing that decays little, [rad/s], by the best fit of two neighbours to each sample (Prony)."""
    middle, sides = motion[1:-1], motion[2:] + motion[:-2]
    return float(np.arccos(np.clip(middle @ sides / (middle @ middle) / 2, -1, 1)) / PERIOD_S)


def test_beta_is_differentiable():
    sim, shapes, gradients, _, damping = column()
    state = sim.rest(v=0.1 * shapes[..., 0], C=0.1 * gradients[..., 0])
    beta = torch.tensor(3e-3, dtype=torch.float64, requires_grad=True)
    weight = torch.linspace(-1, 1, state.data.numel(), dtype=torch.float64).reshape(state.data.shape)
    assert torch.autograd.gradcheck(lambda b: (damping.kick(state, b).data * weight).sum(), beta)


def test_mismatched_mode_shapes_are_refused_in_a_sentence():
    sim, shapes, gradients, frequencies, _ = column()
    with pytest.raises(InputError, match=r"need gradients .*2 frequencies"):
        ModalDamping(shapes, gradients[..., :1], frequencies, masses(sim), period_s=PERIOD_S)
