"""The box that a frame runs on changes no bit of it."""

from __future__ import annotations

import pytest
import torch

from benchmarks.bars import Bar, fitted
from diffphys_ros.simulate import Simulator


@pytest.mark.parametrize("cells", [2.7, 3.0])
def test_a_motion_is_the_same_to_the_bit_whatever_the_simulator_did_before(cells):
    """Room for boxes grows with what was simulated; in single precision a box with a rounded origin of its own would show."""
    bar = Bar(width=0.1, thickness=0.1)
    sim = Simulator(*fitted(bar, cells, 1.5), substeps=50, period_s=1 / 30)
    force = torch.zeros(6, *sim.x_rest.shape)
    force[:3, :, 1] = 600.0
    with torch.no_grad():
        first, second = (sim.rollout(sim.rest(), sim.tensor(bar.young), sim.tensor(bar.poisson), force, 0.2).data for _ in range(2))
    assert torch.equal(first, second)
