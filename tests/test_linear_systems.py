"""Equations that may be singular."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.linear_systems import inverted, solved


def test_regular_equations_are_solved_to_the_bit():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 5, 5))
    matrix, right = a @ a.T + np.eye(5), b[0]
    assert np.array_equal(solved(matrix, right), np.linalg.solve(matrix, right))
    assert np.array_equal(inverted(matrix), np.linalg.inv(matrix))


def test_a_direction_that_nothing_tells_of_stays_as_it_is():
    matrix = np.diag([2.0, 0.0, 4.0])
    assert solved(matrix, np.array([2.0, 0.0, 8.0])) == pytest.approx([1.0, 0.0, 2.0])
    assert inverted(matrix) == pytest.approx(np.diag([0.5, 0.0, 0.25]))


def test_numbers_that_are_not_finite_are_refused():
    for call in (lambda: solved(np.eye(2), np.array([1.0, np.nan])), lambda: inverted(np.full((2, 2), np.inf))):
        with pytest.raises(ValueError, match="not finite"):
            call()
