"""What is believed before the fit, in the unit of what the start values claim of log E."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffphys_ros.config import Settings
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.prior import Prior
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.inverse.unknowns import Layout
from diffphys_ros.start.along import DEARER, along_of


@pytest.fixture
def cost(prepared: Prepared):
    """cost("young", value): of one unknown that is off by so much while all others are as believed."""
    start = replace(prepared.start, track_cost=0.0)
    layout = Layout.of(start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.zeros((2, 0)), held=())
    prior = Prior.of(layout, start, start_scale=1.0, ways=along_of(prepared.body)[None])

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


def test_a_force_along_a_bar_that_leaves_its_held_face_askew_costs_more_and_one_across_does_not(prepared: Prepared, quick_settings: Settings) -> None:
    body, lean = prepared.body, np.deg2rad(12.0)
    x, y = np.meshgrid(*(start + body.pitch_m * np.arange(count) for start, count in zip(body.origin, body.inside.shape, strict=True)), indexing="ij")
    askew = replace(body, inside=np.abs(np.cos(lean) * (y + 0.03) - np.sin(lean) * x) < 0.015)
    problem = pose_problem(replace(prepared, body=askew), None, quick_settings)
    first = problem.layout.force_slice.start

    def cost(*way: float) -> float:
        return float(np.array(way) @ problem.objective.prior.hessian[first : first + 3, first : first + 3] @ way)

    across = cost(-np.sin(lean), np.cos(lean), 0.0)
    assert cost(np.cos(lean), np.sin(lean), 0.0) == pytest.approx(DEARER**2 * cost(0.0, 0.0, 1.0), rel=0.02)
    assert across == pytest.approx(cost(0.0, 0.0, 1.0), rel=0.2)


def test_a_force_along_the_body_is_believed_to_be_what_the_first_answer_has_and_one_across_to_change_little(prepared: Prepared) -> None:
    pushed = replace(prepared.start, force=prepared.start.force @ np.array([[1.0, 0, 0], [0.25, 1, 0], [0, 0, 1]]), track_cost=0.0)
    layout = Layout.of(pushed, prepared.body, force_unit=100.0, initial_modes=0, motion_unit=np.zeros((2, 0)), held=())
    prior = Prior.of(layout, pushed, start_scale=1.0, ways=along_of(prepared.body)[None])

    def cost(*ways: bool) -> float:
        z = layout.start.copy()
        z[layout.force_slice] = (z[layout.force_slice].reshape(-1, 3) * ways).ravel()
        return float(prior.value(torch.as_tensor(z)))

    assert cost(True, False, False) == pytest.approx(0.0, abs=1e-12)
    assert 0 < cost(True, True, True) < cost(False, True, True)


def test_a_gust_of_a_third_of_a_second_costs_less_than_to_miss_a_fiftieth_of_the_motion(prepared: Prepared) -> None:
    """Else it pays to flatten it; where pictures and depth alone tell the motion, more is left to the prior."""
    forced = np.zeros_like(prepared.start.forced)
    forced[1:10] = True
    start = replace(prepared.start, forced=forced)
    layout = Layout.of(start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.zeros((2, 0)), held=())
    z = np.zeros(layout.size)
    z[layout.force_slice].reshape(-1, 3)[:, 2] = 2.0 * np.sin(np.pi * (np.arange(9) + 0.5) / 9)  # in units of the accelerations that are seen
    missed = 0.5 * 0.02**2

    def cost(*, tracked: bool) -> float:
        return float(Prior.of(layout, start, start_scale=1.0, ways=along_of(prepared.body)[None], tracked=tracked).value(torch.as_tensor(z)))

    assert 0.1 * missed < cost(tracked=True) < missed < cost(tracked=False)
