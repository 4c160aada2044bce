"""What is believed before the fit, in the unit of what the start values claim of log E."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.prior import Prior
from diffphys_ros.inverse.unknowns import Layout


@pytest.fixture
def cost(prepared: Prepared):
    """cost("young", value): of one unknown that is off by so much while all others are as believed."""
    start = replace(prepared.start, track_cost=0.0)
    layout = Layout.of(start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.zeros((2, 0)), held=())
    prior = Prior.of(layout, start, start_scale=1.0)

    def of(block: str, value: float) -> float:
        z = np.zeros(layout.size)
        z[layout.slices[block].start] = value
        return float(prior.value(torch.as_tensor(z)))

    return of


def test_a_density_that_is_15_percent_off_costs_what_a_modulus_costs_that_is_a_standard_deviation_off(prepared: Prepared, cost) -> None:
    one = cost("young", float(np.log(10) * prepared.start.log10_young_sd[0]))
    assert one > 0
    assert cost("density", 0.15) == pytest.approx(one)


def test_poisson_s_ratio_costs_as_much_where_it_is_a_twentieth_off(prepared: Prepared, cost) -> None:
    one = cost("young", float(np.log(10) * prepared.start.log10_young_sd[0]))
    assert cost("poisson", 1.0) == pytest.approx(one)  # in units of .05
