"""Cells, particles and iterations."""

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.recover.plan import QUICK_S, make_plan

from .conftest import YOUNG, make_body


def plan(*, device="cpu", **settings):
    return make_plan(make_body(), YOUNG, frames=40, period_s=1 / 30, settings=build(settings), device=device)


def test_more_time_buys_a_finer_grid_and_the_expected_time_keeps_the_budget():
    quick, slow = plan(**{"fit.time_budget_s": 10.0}), plan(**{"fit.time_budget_s": 3000.0})
    assert slow.cells > quick.cells
    for p, budget in ((quick, 10.0), (slow, 3000.0)):
        assert p.iterations * p.seconds_per_iteration <= budget


def test_settings_overrule_the_choice():
    p = plan(**{"particles.cells": 3, "particles.per_cell": 1.0, "fit.iterations": 7, "fit.image_every": 5})
    assert (p.cells, p.per_cell, p.iterations, p.image_every) == (3, 1.0, 7, 5)


def test_the_bound_on_substeps_limits_the_stiffness_not_the_time_step():
    with pytest.raises(InputError, match=r"fit.max_substeps 5: .* raise it to"):
        plan(**{"fit.max_substeps": 5})
    bounded = plan(**{"fit.max_substeps": 60})
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
    assert plan(**{"particles.cells": 6}).cells == 6
