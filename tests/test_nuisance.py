"""Functions of time whose factors nobody knows."""

from __future__ import annotations

import numpy as np

from diffphys_ros.nuisance import Nuisance


def test_what_is_observed_is_weighed_as_by_noise_that_such_functions_are_part_of() -> None:
    rng = np.random.default_rng(0)
    functions, observed = rng.normal(size=(9, 3)), rng.normal(size=9)
    weighed = Nuisance.of(functions).weighed(observed)
    np.testing.assert_allclose(weighed @ weighed, observed @ np.linalg.solve(np.eye(9) + functions @ functions.T, observed))


def test_large_ones_count_for_nothing_and_small_ones_as_all_else() -> None:
    rng = np.random.default_rng(1)
    shape, rest = rng.normal(size=(8, 1)), rng.normal(size=(8, 2, 3))
    rest -= np.tensordot(shape @ shape.T, rest, 1) / (shape.T @ shape)
    np.testing.assert_allclose(Nuisance.of(1e6 * shape).weighed(np.hstack([shape, 2 * shape])), 0.0, atol=1e-5)
    np.testing.assert_allclose(Nuisance.of(1e6 * shape).weighed(rest), rest)
    np.testing.assert_allclose(Nuisance.of(1e-6 * shape).weighed(shape), shape)


def test_without_a_frame_nothing_is_left_of_nothing() -> None:
    assert Nuisance.of(np.zeros((0, 3))).weighed(np.zeros((0, 4))).shape == (0, 4)
