"""What the materials do: sand heaps up at its angle of repose, plasticine keeps its shape, a fluid levels out."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from diffphys_ros.errors import InputError
from diffphys_ros.simulate import Plane, Simulator, State, substeps_per_frame
from diffphys_ros.simulate.stability import max_viscosity
from diffphys_ros.types import Grid

from ..bodies import block, full

DX, PERIOD_S, POISSON, G = 0.02, 1 / 30, 0.3, 9.81
COLUMN = (6, 1, 8)  # cells along x, y and z
WIDTH, HEIGHT = COLUMN[0] * DX, COLUMN[2] * DX


def basin(
    law: str,
    *,
    left: int,
    right: int,
    kind: str,
    young: float = 1e5,
    density: float = 1000.0,
    dtype: torch.dtype = torch.float64,
    batch: int | None = None,
    **parameters: float | torch.Tensor,
) -> Simulator:
    """A column on a floor between two panes a cell apart, with walls `left` and `right` cells beside it."""
    particles, _ = block(COLUMN, dx=DX, density=density, poisson=POISSON, clamped=False)
    room = 3
    size = (left + COLUMN[0] + right + 2 * room + 1, COLUMN[1] + 2 * room + 1, COLUMN[2] + 2 * room + 3)
    grid = Grid(np.array([-left - room, -room, -room]) * DX, DX, size, -1)
    panes = Plane((0, 1, 0), 0.0, "slip"), Plane((0, -1, 0), -COLUMN[1] * DX, "slip")
    walls = Plane((1, 0, 0), -left * DX, kind), Plane((-1, 0, 0), -WIDTH - right * DX, kind)
    substeps = substeps_per_frame(young, POISSON, density, dx=DX, period_s=PERIOD_S, margin=1.2)
    planes = (Plane((0, 0, 1), 0.0, kind), *panes, *walls)
    options = {"substeps": substeps, "period_s": PERIOD_S, "gravity": (0, 0, -G), "planes": planes, "dtype": dtype, "batch": batch}
    return Simulator(particles, grid, law=law, law_parameters=parameters, **options)


def run(sim: Simulator, frames: int, *, young: float = 1e5, push: torch.Tensor | None = None, damping: float = 0.0) -> State:
    force = sim.tensor(torch.zeros(frames, len(sim.volume), 3))
    if push is not None:
        force[: len(push)] = push[:, None].to(force)
    return sim.rollout(sim.rest(), full(sim, young), full(sim, POISSON), force, damping)


def steepness(x: torch.Tensor) -> float:
    """Height over half width of the triangular heap that has the same mean height and mean distance from the middle."""
    return float(x[:, 2].mean() / (x[:, 0] - WIDTH / 2).abs().mean())


def test_a_column_of_sand_collapses_to_a_heap_that_is_steeper_for_a_larger_friction_angle():
    slopes = []
    for degrees in (15, 25, 35):
        path = run(basin("drucker_prager", left=24, right=24, kind="sticky", density=1600.0, friction_angle_rad=math.radians(degrees)), 26)
        assert path.v[-1].abs().mean() < 2e-3, "the heap must have come to rest"
        assert path.x[-1, :, 2].max() < 0.6 * HEIGHT
        slopes.append(steepness(path.x[-1]))
        assert 0.7 < slopes[-1] / math.tan(math.radians(degrees)) < 1.0
        assert float(torch.det(path.F[-1]).mean()) == pytest.approx(1.0, abs=0.03)
    assert slopes == sorted(slopes)


def test_plasticine_keeps_the_shape_it_was_pressed_into_and_an_elastic_body_returns():
    push, kept = torch.zeros(6, 3), {}
    push[:, 2] = -4e4  # N/m^3: some 6 kPa at the foot
    for law, parameters in (("von_mises", {"yield_stress_pa": 3e3}), ("neo_hookean", {})):
        path = run(basin(law, left=6, right=6, kind="sticky", **parameters), 24, push=push, damping=20.0)
        shorter = HEIGHT - DX / 2 - (path.x[:, -1, 2] - path.x[:, 0, 2])
        assert shorter[6] > 0.03 * HEIGHT
        kept[law] = float(shorter[-1] / shorter[6])
    assert kept["von_mises"] > 0.85
    assert kept["neo_hookean"] < 0.25  # what is left is the sag under its weight


def test_a_column_of_fluid_levels_out_and_keeps_its_volume():
    path = run(basin("weakly_compressible", left=0, right=6, kind="slip", viscosity_pa_s=10.0), 40)
    x, level = path.x[-1], HEIGHT / 2
    ratio = torch.det(path.F[-1])
    assert float(x[:, 2].mean()) == pytest.approx(level / 2, rel=0.04)
    assert float(ratio.mean()) == pytest.approx(1.0, abs=0.01)
    columns = [float(x[(x[:, 0] / DX).floor() == i, 2].max()) for i in range(2 * COLUMN[0])]
    assert max(columns) - min(columns) < DX
    assert max(columns) == pytest.approx(level, rel=0.1)


def test_a_more_viscous_fluid_spreads_more_slowly():
    reach = [
        float(run(basin("weakly_compressible", left=0, right=6, kind="slip", viscosity_pa_s=eta), 5).x[-1, :, 0].max())
        for eta in (0.0, 40.0, 100.0)
    ]
    assert reach[0] > reach[1] > reach[2]


@pytest.mark.parametrize(
    ("law", "name", "value"),
    [("von_mises", "yield_stress_pa", 800.0), ("drucker_prager", "friction_angle_rad", 0.6), ("weakly_compressible", "viscosity_pa_s", 10.0)],
)
def test_the_gradient_of_a_collapse_along_a_laws_own_parameter_equals_central_differences(law, name, value):
    def lean(parameter: torch.Tensor) -> torch.Tensor:
        path = run(basin(law, left=20, right=20, kind="sticky", dtype=torch.float64, **{name: parameter}), 6)
        return path.x[-1, :, 2].mean() + (path.x[-1, :, 0] - WIDTH / 2).square().mean() / WIDTH

    parameter = torch.tensor(value, dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(lean(parameter), parameter)
    with torch.no_grad():
        above, below = (lean(parameter * (1 + sign * 3e-6)) for sign in (1, -1))
    assert float(slope) == pytest.approx(float(above - below) / (6e-6 * value), rel=1e-5)


def test_simulations_of_a_batch_may_differ_in_a_laws_own_parameter():
    yields = torch.tensor([500.0, 900.0, 1e4])
    together = run(basin("von_mises", left=6, right=6, kind="sticky", batch=3, yield_stress_pa=yields[:, None]), 3)
    for k, value in enumerate(yields):
        alone = run(basin("von_mises", left=6, right=6, kind="sticky", yield_stress_pa=float(value)), 3)
        assert torch.equal(together.x[:, k], alone.x)


def test_parameters_that_a_law_does_not_have_or_cannot_take_are_refused_in_a_sentence():
    with pytest.raises(InputError, match=r"von_mises has no 'friction_angle_rad'; choose from yield_stress_pa"):
        basin("von_mises", left=1, right=1, kind="slip", friction_angle_rad=0.5)
    with pytest.raises(InputError, match="neo_hookean has no 'yield_stress_pa'; leave it out"):
        basin("neo_hookean", left=1, right=1, kind="slip", yield_stress_pa=1e3)
    with pytest.raises(InputError, match=r"friction_angle_rad reaches from 35 to 35, must be in 0 .. 1.0472"):
        basin("drucker_prager", left=1, right=1, kind="slip", friction_angle_rad=35.0)


def test_a_fluid_too_viscous_for_the_substeps_is_answered_with_the_viscosity_they_carry():
    carried = max_viscosity(substeps_per_frame(1e5, POISSON, 1000.0, dx=DX, period_s=PERIOD_S, margin=1.2), 1000.0, dx=DX, period_s=PERIOD_S)
    with pytest.raises(InputError, match=rf"viscosity_pa_s is {1.1 * carried:.3g} Pa s, .* lower it below {carried:.3g} or raise the substeps"):
        basin("weakly_compressible", left=0, right=6, kind="slip", viscosity_pa_s=1.1 * carried)
    path = run(basin("weakly_compressible", left=0, right=6, kind="slip", viscosity_pa_s=0.99 * carried), 20)
    assert path.v.abs().max() < 1.0


def test_substeps_follow_the_viscosity_where_it_asks_for_more_than_the_waves():
    substeps = substeps_per_frame(1e5, POISSON, 1000.0, dx=DX, period_s=PERIOD_S, viscosity_pa_s=1e3)
    assert float(max_viscosity(substeps, 1000.0, dx=DX, period_s=PERIOD_S)) >= 1e3 > float(max_viscosity(substeps - 1, 1000.0, dx=DX, period_s=PERIOD_S))
