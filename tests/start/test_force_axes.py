"""What a force costs in directions that are not seen."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.start.force import AXES, UNSEEN_SHARE, cost_of_axes


def test_where_all_is_seen_only_the_axis_of_the_body_costs_more() -> None:
    np.testing.assert_array_equal(cost_of_axes(None), np.diag(AXES))
    np.testing.assert_allclose(cost_of_axes(np.repeat(np.eye(3)[None], 5, 0)), np.diag(AXES), atol=1e-12)


def test_a_force_along_the_line_of_sight_costs_ten_times_as_much_and_one_across_it_no_more() -> None:
    sight = np.array([0.0, 0.6, 0.8])
    cost = cost_of_axes(np.repeat((np.eye(3) - np.outer(sight, sight))[None], 5, 0))
    assert np.linalg.norm(cost @ sight) == pytest.approx(1 / UNSEEN_SHARE)
    assert np.linalg.norm(cost @ [0.0, 0.8, -0.6]) == pytest.approx(1.0)
