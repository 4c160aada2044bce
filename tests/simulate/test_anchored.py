"""Particles that keep the weights of a motion's start: positions and deformation stay one motion, however long it lasts."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import Handle, Plane, Simulator, State

from .bodies import block, full, simulator

YOUNG, POISSON, DENSITY, PERIOD_S = 2e5, 0.3, 600.0, 1 / 30
LENGTH, TIP = 0.24, 0.22
SWING = 0.6  # [m/s] of the tip


def beam(**options: object) -> Simulator:
    """A cantilever that gravity bends by a sixth of its length."""
    body = block((12, 3, 3), dx=0.02, margin=5, density=DENSITY, poisson=POISSON)
    return simulator(body, substeps=60, period_s=PERIOD_S, gravity=(0.0, -9.81, 0.0), **options)


def onward(sim: Simulator, state: State, anchor: State, damping: float, frames: int) -> State:
    """The state after more frames of a motion that started from `anchor`."""
    for _ in range(frames):
        state = sim.frame(state, full(sim, YOUNG), full(sim, POISSON), None, damping, anchor=anchor)
    return state


def tip(sim: Simulator, state: State) -> float:
    return float(state.x[sim.x_rest[:, 0] > TIP, 1].mean())


STRUCK = -0.058  # [m]: a floor that the swinging tip strikes; the hanging one ends at -0.042 m


@pytest.mark.slow
@pytest.mark.parametrize("floor", [None, -0.2, STRUCK], ids=["no floor", "a floor out of reach", "a floor that its tip strikes"])
def test_a_body_set_swinging_under_gravity_and_damped_comes_to_rest_where_it_was(floor):
    """With weights that move along it comes to rest a tenth of its sag lower."""
    sim = beam(planes=[] if floor is None else [Plane((0, 1, 0), floor)])
    start = sim.rest()
    with torch.no_grad():
        hanging = onward(sim, start, start, 12.0, 40)
        along = SWING * (sim.x_rest[:, :1] / LENGTH) ** 2
        swinging = [hanging.replace(v=along * sim.tensor([0.0, 1.0, 0.0]))]
        for _ in range(20):
            swinging.append(onward(sim, swinging[-1], start, 0.0, 1))
        resting = onward(sim, swinging[-1], start, 12.0, 40)
    sag = tip(sim, start) - tip(sim, hanging)
    assert sag > LENGTH / 8, "the body must hang under its weight for this to mean anything"
    lowest = min(float(state.x[:, 1].min()) for state in swinging)
    assert (lowest > STRUCK) == (floor == STRUCK), "the floor must be struck where it is to be, and hold"
    assert abs(tip(sim, resting) - tip(sim, hanging)) < 1e-3 * sag


def spun(sim: Simulator, turns_per_s: float) -> tuple[State, Tensor]:
    """A free body in rigid rotation about its centre, and the velocity gradient."""
    spin = sim.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) * 2 * np.pi * turns_per_s
    arm = sim.x_rest - sim.x_rest.mean(0)
    return sim.rest(v=arm @ spin.T, C=spin.expand(len(arm), 3, 3)), spin


def test_a_rigid_spin_leaves_the_deformation_a_rotation_and_the_positions_with_it():
    sim = simulator(block((3, 2, 2), dx=0.02, clamped=False, margin=6), substeps=60, period_s=PERIOD_S)
    start, spin = spun(sim, 3.0)
    with torch.no_grad():
        path = sim.rollout(start, full(sim, 1e6), full(sim, POISSON), torch.zeros(20, *sim.x_rest.shape), 0.0)
    turns = torch.linalg.matrix_exp(spin * PERIOD_S * torch.arange(21)[:, None, None])
    unit = torch.eye(3, dtype=torch.float64).expand_as(path.F)
    torch.testing.assert_close(path.F.mT @ path.F, unit, rtol=0, atol=2e-3)
    torch.testing.assert_close(path.F, turns[:, None].expand_as(path.F), rtol=0, atol=0.02)
    arm = sim.x_rest - sim.x_rest.mean(0)
    moved = path.x - path.x.mean(1, keepdim=True)
    assert (moved - torch.einsum("tpab,pb->tpa", path.F, arm)).abs().max() < 1e-3 * arm.abs().max()


def test_positions_and_deformation_of_an_affine_motion_agree_to_rounding():
    """What one substep adds to both is the same affine field of the start, so that nothing is left to add up."""
    sim = simulator(block((3, 2, 2), dx=0.02, clamped=False, margin=6, jitter=0.2), substeps=60, period_s=PERIOD_S)
    rate = sim.tensor([[0.5, -3.0, 0.2], [2.0, -0.4, 1.0], [0.3, -0.6, 0.1]])
    start = sim.rest(v=sim.x_rest @ rate.T, C=rate.expand(len(sim.volume), 3, 3))
    with torch.no_grad():
        path = sim.rollout(start, full(sim, 1e-9), full(sim, POISSON), torch.zeros(5, *sim.x_rest.shape), 0.0)
    torch.testing.assert_close(path.x, torch.einsum("tpab,pb->tpa", path.F, sim.x_rest), rtol=0, atol=1e-12)
    assert (path.F[-1] - torch.eye(3)).abs().max() > 0.3


@pytest.mark.parametrize("told", [True, False], ids=["told its start", "taken up anew"])
def test_frame_by_frame_a_motion_is_its_rollout(told):
    """To the bit where each frame is told the start; near it where weights are those of the frame before."""
    sim = beam()
    start = sim.rest(v=sim.x_rest * sim.tensor([0.1, 0.0, 0.0]))
    state, path = start, torch.zeros(3, *sim.x_rest.shape)
    with torch.no_grad():
        last = sim.rollout(start, full(sim, YOUNG), full(sim, POISSON), path, 0.5).data[-1]
        for _ in range(3):
            state = sim.frame(state, full(sim, YOUNG), full(sim, POISSON), None, 0.5, anchor=start if told else None)
    moved = (State(last).x - start.x).abs().max()
    assert (state.x - State(last).x).abs().max() <= (0 if told else 0.02) * moved


@pytest.mark.parametrize("name", ["x", "F"])
def test_the_gradient_along_the_start_that_a_whole_rollout_is_anchored_to_equals_central_differences(name):
    body = block((4, 3, 3), dx=0.02, per_cell=1.5, jitter=0.2)
    sim = simulator(body, substeps=12, period_s=12 * 4e-4, gravity=(0.3, -9.81, 0.5), anchored=True)
    rng = np.random.default_rng(4)
    draw = lambda *shape: sim.tensor(rng.normal(size=shape))  # noqa: E731
    count = len(sim.volume)
    at = {"x": sim.x_rest, "F": torch.eye(3) + 0.05 * draw(count, 3, 3)}
    steps = {"x": 1e-3 * draw(count, 3), "F": 0.02 * draw(count, 3, 3)}
    weight, force, v = draw(4, count, 24), 3000 * draw(3, count, 3), 0.3 * draw(count, 3)

    def loss(value: Tensor) -> Tensor:
        start = sim.rest(**{**at, name: value}, v=v)
        return (sim.rollout(start, full(sim, 1e5), full(sim, POISSON), force, 0.7).data * weight).sum()

    value = at[name].clone().requires_grad_()
    (bar,) = torch.autograd.grad(loss(value), value)
    with torch.no_grad():
        ahead, behind = (float(loss(at[name] + sign * 1e-4 * steps[name])) for sign in (1, -1))
    assert float((bar * steps[name]).sum()) == pytest.approx((ahead - behind) / 2e-4, rel=1e-5)


STICKY, GRIP = Plane((0, 1, 0), -0.5, "sticky"), Handle((-0.02, -1.0, -1.0), (0.0, 1.0, 1.0))


@pytest.mark.parametrize("options", [{"law": "von_mises"}, {"planes": [STICKY]}, {"handle": GRIP}], ids=["flows", "stuck", "held"])
def test_what_flows_or_is_held_is_not_anchored(options):
    assert not beam(**options).anchored
    assert beam().anchored
    assert beam(planes=[Plane((0, 1, 0), -0.5)]).anchored
    with pytest.raises(InputError, match="leave `anchored` out"):
        beam(anchored=True, **options)


@pytest.mark.parametrize(("per_cell", "anchored"), [(1.5, False), (2.0, True)])
def test_particles_too_few_to_hold_every_motion_of_the_lattice_are_not_anchored(per_cell, anchored):
    sim = simulator(block((4, 4, 4), dx=0.02, per_cell=per_cell), substeps=60, period_s=PERIOD_S)
    assert sim.anchored == anchored
