"""The simulated motion obeys mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from diffphys_ros.simulate import State
from diffphys_ros.simulate.laws import LAWS

from .bodies import block, full, masses, simulator

PERIOD_S = 1 / 30


def random_motion(sim, seed: int = 0) -> State:
    """A free block that flies, spins and shears."""
    rng = np.random.default_rng(seed)
    spin = sim.tensor(rng.normal(size=(3, 3)) * 2)
    return sim.rest(v=sim.tensor([0.2, -0.1, 0.1]) + sim.x_rest @ spin.T, C=spin.expand(len(sim.volume), 3, 3))


def angular_momentum(sim, state: State) -> torch.Tensor:
    """About the origin; a particle's affine motion carries m dx^2/4 C (quadratic splines)."""
    mass, affine = masses(sim), sim.grid.dx**2 / 4
    skew = state.C - state.C.mT
    own = affine * torch.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], -1)
    return (mass[:, None] * (torch.linalg.cross(state.x, state.v) + own)).sum(0)


def energy(sim, state: State, young: float) -> float:
    """Kinetic, of particles and their affine motion, and neo-Hookean [J]."""
    nu = sim.particles.poisson[0]
    mu, lam = young / (2 * (1 + nu)), young * nu / ((1 + nu) * (1 - 2 * nu))
    log_j = torch.log(torch.det(state.F))
    elastic = mu / 2 * (state.F.square().sum((1, 2)) - 3) - mu * log_j + lam / 2 * log_j**2
    kinetic = state.v.square().sum(1) / 2 + sim.grid.dx**2 / 8 * state.C.square().sum((1, 2))
    return float((sim.volume * elastic + masses(sim) * kinetic).sum())


def test_a_free_body_falls_along_a_parabola():
    sim = simulator(block((3, 3, 3), dx=0.02, clamped=False, margin=8), substeps=40, period_s=PERIOD_S, gravity=(0, 0, -9.81))
    path = sim.rollout(sim.rest(), full(sim, 1e5), full(sim, 0.3), torch.zeros(4, *sim.x_rest.shape), 0.0)
    t = torch.arange(5, dtype=torch.float64) * PERIOD_S
    fallen = (path.x - sim.x_rest)[..., 2]
    expected = (-9.81 / 2 * t * (t + PERIOD_S / 40)).to(fallen)  # symplectic Euler's exact sum
    torch.testing.assert_close(fallen, expected[:, None].expand_as(fallen), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("law", "anchored"), [(law, False) for law in LAWS] + [("neo_hookean", True)])
def test_linear_and_angular_momentum_of_a_free_body_are_kept(law, anchored):
    """Anchored particles keep the angular one to what their affine motions do not see of their neighbours'."""
    body = block((3, 2, 2), dx=0.02, clamped=False, margin=5, jitter=0.1)
    sim = simulator(body, substeps=60, period_s=PERIOD_S, law=law, anchored=anchored)
    start = random_motion(sim)
    after = sim.frame(start, full(sim, 5e4), full(sim, 0.3), None, 0.0)
    mass = masses(sim)[:, None]
    torch.testing.assert_close((mass * after.v).sum(0), (mass * start.v).sum(0), rtol=1e-11, atol=1e-14)
    torch.testing.assert_close(angular_momentum(sim, after), angular_momentum(sim, start), rtol=5e-4 if anchored else 1e-10, atol=1e-14)
    strain = (torch.pdist(after.x) / torch.pdist(start.x) - 1).abs().max()
    assert max(strain, (after.F - torch.eye(3)).abs().max()) > 0.01, "the body must have deformed for this to mean anything"


@pytest.mark.parametrize("law", LAWS)
def test_a_rotated_body_is_free_of_stress(law):
    sim = simulator(block((3, 3, 3), dx=0.02, clamped=False, margin=5), substeps=30, period_s=PERIOD_S, law=law)
    turn = torch.linalg.matrix_exp(sim.tensor([[0.0, -0.7, 0.2], [0.7, 0.0, -0.4], [-0.2, 0.4, 0.0]]))
    state = sim.rest(x=sim.x_rest @ turn.T, F=turn.expand(len(sim.volume), 3, 3))
    after = sim.frame(state, full(sim, 1e5), full(sim, 0.3), None, 0.0)
    torch.testing.assert_close(after.data[:, :15], state.data[:, :15], rtol=0, atol=1e-10)


@pytest.mark.parametrize("force_on", ["particles", "nodes"])
@pytest.mark.parametrize("offset", [0.0, 0.13, 0.5, 0.77])
def test_a_uniform_force_density_adds_up_to_force_times_volume(offset, force_on):
    body = block((4, 3, 2), dx=0.02, clamped=False, margin=4, offset=offset, jitter=0.2)
    sim = simulator(body, substeps=20, period_s=PERIOD_S, force_on=force_on)
    density = sim.tensor([30.0, -200.0, 90.0])
    shape = sim.x_rest.shape if force_on == "particles" else (*sim.grid.size, 3)
    after = sim.frame(sim.rest(), full(sim, 2e4), full(sim, 0.3), density.expand(shape), 0.0)
    gained = (masses(sim)[:, None] * after.v).sum(0)
    torch.testing.assert_close(gained, density * sim.volume.sum() * PERIOD_S, rtol=1e-6, atol=0)


def test_mass_damping_slows_a_free_body_exponentially():
    sim = simulator(block((2, 2, 2), dx=0.02, clamped=False, margin=5), substeps=25, period_s=PERIOD_S)
    after = sim.frame(sim.rest(v=torch.ones_like(sim.x_rest) * 0.3), full(sim, 1e5), full(sim, 0.3), None, 4.0)
    torch.testing.assert_close(after.v, torch.full_like(after.v, 0.3 * math.exp(-4.0 * PERIOD_S)))


@pytest.mark.parametrize("anchored", [True, False])
def test_energy_of_a_clamped_vibration_never_rises_and_falls_by_what_damping_takes(anchored):
    young, alpha, frames = 2e5, 1.5, 12
    sim = simulator(block((20, 4, 4), dx=0.015, per_cell=1.5), substeps=73, period_s=PERIOD_S, anchored=anchored)
    force = torch.zeros(frames, *sim.x_rest.shape)
    free, damped = (
        sim.rollout(sim.rest(v=first_mode(sim, 0.3)), full(sim, young), full(sim, 0.3), force, rate).data for rate in (0.0, alpha)
    )
    kept, left = (np.array([energy(sim, State(data), young) for data in path]) for path in (free, damped))
    assert np.all(np.diff(kept) < 0)
    assert np.all(np.diff(left) < 0)
    assert kept[-1] > 0.975 * kept[1], "affine transfers alone take little"
    power = alpha * np.array([float((masses(sim) * State(data).v.square().sum(1)).sum()) for data in damped])
    taken = PERIOD_S * (power[1:-1].sum() + (power[0] + power[-1]) / 2)
    lattice = 1 - kept[-1] / kept[0]  # the share that goes without damping
    assert left[0] - left[-1] == pytest.approx(taken + lattice * (left[0] + left[-1]) / 2, rel=0.03)


def first_mode(sim, length: float, axis: int = 1) -> torch.Tensor:
    """Velocities (P, 3) close to a cantilever's first bending mode, 5 cm/s at the tip."""
    s, v = sim.x_rest[:, 0] / length, torch.zeros_like(sim.x_rest)
    v[:, axis] = 0.05 * s**2 * (6 - 4 * s + s**2) / 3
    return v
