"""Gravity as prestress: the body starts in static equilibrium."""

from __future__ import annotations

import pytest
import torch

from diffphys_ros.errors import SimulationError

from .bodies import block, full, simulator

LENGTH, YOUNG, DENSITY, G = 0.24, 1e5, 1000.0, 9.81
HANGING, UPRIGHT = G, -G  # gravity along x, which leaves the clamp


def column(gravity: float):
    """A bar of Poisson's ratio zero under axial gravity: stretched by rho g (L - x) / E at x."""
    body = block((12, 2, 2), dx=0.02, poisson=0.0, density=DENSITY)
    return simulator(body, substeps=40, period_s=1 / 30, gravity=(gravity, 0.0, 0.0))


def sag_gradient(sim, gravity: float) -> torch.Tensor:
    """Gradient of the exact static displacement, shape (P, 3, 3)."""
    gradient = torch.zeros(len(sim.volume), 3, 3, dtype=torch.float64)
    gradient[:, 0, 0] = DENSITY * gravity * (LENGTH - sim.x_rest[:, 0]) / YOUNG
    return gradient


def tip_sag(gravity: float) -> float:
    return DENSITY * gravity * LENGTH**2 / (2 * YOUNG)


@pytest.mark.parametrize("gravity", [HANGING, UPRIGHT])
def test_a_column_sags_by_the_analytic_amount(gravity):
    sim = column(gravity)
    zero = torch.zeros(len(sim.volume), 3, 3, dtype=torch.float64)
    with torch.no_grad():
        settled = sim.settle(full(sim, YOUNG), full(sim, 0.0), zero, frames=25)
    tip = sim.x_rest[:, 0].argmax()
    assert float(settled.x[tip, 0] - sim.x_rest[tip, 0]) == pytest.approx(tip_sag(gravity), rel=0.05)


@pytest.mark.parametrize("gravity", [HANGING, UPRIGHT])
def test_a_settled_body_stays_where_frame_0_saw_it(gravity):
    sim = column(gravity)
    with torch.no_grad():
        settled = sim.settle(full(sim, YOUNG), full(sim, 0.0), sag_gradient(sim, gravity), frames=6)
        path = sim.rollout(settled, full(sim, YOUNG), full(sim, 0.0), torch.zeros(15, *sim.x_rest.shape), 0.0)
    sag = abs(tip_sag(gravity))
    assert (settled.x - sim.x_rest).abs().max() < 0.05 * sag
    assert (path.x - settled.x).abs().max() < 0.02 * sag
    assert settled.v.abs().max() == 0.0


def test_a_turn_of_the_sag_puts_no_stress_into_frame_0():
    """A bar that bends far turns its end: taken for a strain, a tenth of a radian would stretch it by half a percent."""
    sim = column(0.0)
    turn = torch.zeros(len(sim.volume), 3, 3, dtype=torch.float64)
    turn[:, 0, 1], turn[:, 1, 0] = -0.1, 0.1
    with torch.no_grad():
        settled = sim.settle(full(sim, YOUNG), full(sim, 0.0), turn, frames=6)
    assert (settled.x - sim.x_rest).abs().max() < 1e-6 * LENGTH


def test_a_column_that_cannot_carry_itself_is_named_with_its_cure():
    sim = column(UPRIGHT)
    with pytest.raises(SimulationError, match=r"settling under gravity, 3 frames before frame 0, .*raise Young's modulus of the softest part, which does not carry its own weight"):
        sim.settle(full(sim, YOUNG / 100), full(sim, 0.0), 100 * sag_gradient(sim, UPRIGHT))


def test_the_settled_state_is_differentiable_in_stiffness():
    sim = column(HANGING)
    young = full(sim, YOUNG).requires_grad_()
    gradient = lambda e: sag_gradient(sim, HANGING) * (YOUNG / e)[:, None, None]  # noqa: E731
    length = sim.settle(young, full(sim, 0.0), gradient(young), frames=2).F[:, 0, 0].sum()
    (slope,) = torch.autograd.grad(length, young)
    with torch.no_grad():
        sides = [sim.settle(young * (1 + s), full(sim, 0.0), gradient(young * (1 + s)), frames=2).F[:, 0, 0].sum() for s in (1e-4, -1e-4)]
    assert float((slope * young.detach()).sum()) == pytest.approx(float(sides[0] - sides[1]) / 2e-4, rel=1e-5)
