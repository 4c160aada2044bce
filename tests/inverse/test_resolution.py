"""Cells, particles and iterations."""

import re

import numpy as np
import pytest

from diffphys_ros.config import TIME_BUDGET_S, build
from diffphys_ros.errors import InputError
from diffphys_ros.inverse.resolution import FIT_SHARE, QUICK_S, make_plan
from diffphys_ros.particles import fill, fit_grid

from .conftest import YOUNG, make_body


def plan(*, device="cpu", reach_m=0.0, dense=0, ahead=0.0, young=YOUNG, **settings):
    return make_plan(make_body(), young, frames=40, period_s=1 / 30, settings=build(settings), device=device, reach_m=reach_m, dense=dense, ahead=ahead)


def test_more_time_buys_a_finer_grid_and_the_expected_time_keeps_its_share_of_the_budget():
    quick, slow = plan(**{"fit.time_budget_s": 20.0}), plan(**{"fit.time_budget_s": 3000.0})
    assert slow.cells > quick.cells
    for p, budget in ((quick, 20.0), (slow, 3000.0)):
        assert p.simulates
        assert p.seconds(p.iterations) <= FIT_SHARE * budget


@pytest.mark.parametrize("device", ["cpu", "cuda:0"])
def test_without_a_budget_a_clip_has_two_minutes_on_a_gpu_and_a_quarter_of_an_hour_on_a_cpu(device):
    assert plan(device=device) == plan(device=device, **{"fit.time_budget_s": TIME_BUDGET_S[device[:4].rstrip(":")]})
    assert TIME_BUDGET_S == {"cpu": 900.0, "cuda": 120.0}


def test_what_is_simulated_before_the_search_is_planned_for():
    alone, after = (plan(ahead=ahead, **{"fit.time_budget_s": 60.0}) for ahead in (0.0, 11.0))
    assert after.seconds_ahead > 0
    assert (after.cells, after.iterations) < (alone.cells, alone.iterations)
    assert after.seconds(after.iterations) <= FIT_SHARE * 60.0


def test_a_clip_too_dear_for_a_fine_grid_has_a_coarser_one():
    """Twenty times the stiffness asks for 4.5 times the substeps."""
    fine, coarse = plan(**{"fit.time_budget_s": 120.0}), plan(young=20 * YOUNG, **{"fit.time_budget_s": 120.0})
    assert coarse.simulates
    assert coarse.cells < fine.cells


@pytest.mark.parametrize(("settings", "young", "said"), [
    ({"fit.time_budget_s": 1.0}, YOUNG, r"not simulated: 2 cells over the thickness with \d+ substeps a frame take about \d+ s, the time budget leaves 0.6 s"),
    ({}, 1e9 * YOUNG, r"not simulated: 2 cells .* need \d+ substeps a frame at E = 2e\+14 Pa, 2000 are the most"),
])  # fmt: skip
def test_a_clip_too_dear_for_every_grid_is_not_simulated_and_says_why(settings, young, said):
    p = plan(young=young, **settings)
    assert (p.simulates, p.iterations) == (False, 0)
    assert re.fullmatch(said, p.text())


def test_settings_overrule_the_choice():
    p = plan(**{"experiment.cells": 3, "experiment.per_cell": 1.0, "fit.iterations": 7, "experiment.image_every": 5})
    assert (p.cells, p.per_cell, p.iterations, p.image_every) == (3, 1.0, 7, 5)


def test_the_bound_on_substeps_limits_the_stiffness_not_the_time_step():
    with pytest.raises(InputError, match=r"particles: 8 cells .* 60 are the most; leave experiment.cells, .* out"):
        plan(**{"experiment.max_substeps": 60, "experiment.cells": 8})
    bounded = plan(**{"experiment.max_substeps": 60})
    assert bounded.substeps <= 60


def test_substeps_follow_the_courant_number_of_one_half_at_the_margin():
    p = plan()
    speed = np.sqrt(1.5 * YOUNG.max() * 0.7 / (1.3 * 0.4) / 600)
    assert p.substeps == np.ceil(speed / 30 / (0.5 * p.dx))


def test_more_than_four_cells_are_taken_only_where_that_costs_half_a_minute_at_most():
    slow, fast = plan(device="cpu"), plan(device="cuda:0")
    assert slow.cells == 4
    assert fast.cells > 4
    assert fast.iterations * fast.seconds_per_iteration <= 2 * QUICK_S
    assert plan(**{"experiment.cells": 6}).cells == 6


@pytest.mark.parametrize("nodes", [24, 64, 128])
@pytest.mark.parametrize("reach_m", [0.0, 0.08])
def test_a_grid_of_so_many_nodes_along_its_longest_side_has_them_within_three(nodes, reach_m):
    p = plan(reach_m=reach_m, **{"experiment.grid_nodes": nodes, "experiment.per_cell": 1.0})
    assert p.cells == pytest.approx(0.1 / p.dx)
    grid = fit_grid(fill(make_body(), p.dx, 1.0), dx=p.dx, reach_m=reach_m + 0.5 * p.dx, clamped=True)
    assert nodes - 3 <= max(grid.size) <= nodes


def test_cells_and_nodes_are_not_both_taken():
    with pytest.raises(InputError, match=r"experiment.cells 4 and experiment.grid_nodes 64 are both given; leave one"):
        plan(**{"experiment.cells": 4, "experiment.grid_nodes": 64})


def test_a_share_of_dense_points_sets_particles_per_cell_and_prefers_grids_that_bend_truly():
    p = plan(dense=100_000, **{"experiment.downsample_ratio": 0.01})
    assert p.kept == 1000
    assert p.per_cell == pytest.approx(p.dx / (0.003 / 1000) ** (1 / 3))
    assert p.per_cell >= 1.6
    coarser = plan(dense=100_000, **{"experiment.downsample_ratio": 0.0035})
    assert coarser.cells < p.cells
    assert coarser.per_cell >= 1.6
    assert plan().kept == 0


def test_a_share_that_leaves_cells_empty_is_refused_with_one_that_does_not():
    with pytest.raises(InputError, match=r"experiment.downsample_ratio 0.0005: keeps 50 of 100000 points, .* each of the 81 cells .* raise it to 0.00082 or lower experiment.cells"):
        plan(dense=100_000, **{"experiment.downsample_ratio": 0.0005})
    assert plan(dense=100_000, **{"experiment.downsample_ratio": 0.00082}).per_cell >= 1
    with pytest.raises(InputError, match=r"raise experiment.max_splats"):
        plan(dense=50, **{"experiment.downsample_ratio": 1.0})
    with pytest.raises(InputError, match=r"per_cell 2 and experiment.downsample_ratio 0.01 are both given"):
        plan(dense=100_000, **{"experiment.downsample_ratio": 0.01, "experiment.per_cell": 2.0})


@pytest.mark.parametrize(("per_cell", "said"), [(1.0, True), (1.5, True), (1.6, False)])
def test_particles_too_few_to_bend_truly_are_named(per_cell, said):
    assert ("fewer than 1.6 bend several percent off" in plan(**{"experiment.per_cell": per_cell}).text()) == said


def test_a_grid_that_no_memory_holds_is_refused_before_it_is_filled():
    settings = build({"experiment.cells": 32, "experiment.per_cell": 4.0})
    with pytest.raises(InputError, match=r"32 cells over the thickness with 4 particles per cell and axis need \d+\.\d GiB, the device has .* leave experiment.cells"):
        make_plan(make_body(), YOUNG, frames=100_000, period_s=1 / 30, settings=settings, device="cpu")
    assert plan().memory_bytes < 2**30
