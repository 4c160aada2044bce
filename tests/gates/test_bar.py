"""The bar of two materials, whose small swing linear modes nearly explain: a simulation must not make it worse."""

from __future__ import annotations

import numpy as np
import pytest

from .conftest import ROUGH, Answer, Recover

YOUNG, RATIO = 0.0135, 0.004  # of log10 E, and of the ratio of both
TRAJECTORY = 0.042  # the linear motion of the start values is .045 off
COSINE, FALSE_FORCE = 0.995, 0.025


@pytest.fixture(scope="module")
def answer(recovered: Recover) -> Answer:
    return recovered("bar")


def test_the_stiffness_of_both_parts_is_that_of_the_other_simulator(answer: Answer) -> None:
    assert np.abs(answer.log10_young_error).max() < YOUNG
    assert answer.metrics["young_ratio_error"] < RATIO


def test_the_motion_is_nearer_than_the_linear_one(answer: Answer) -> None:
    assert answer.trajectory_error < TRAJECTORY
    assert answer.metrics["refined"]


def test_the_force_points_where_it_did_and_ends_where_it_did(answer: Answer) -> None:
    assert answer.metrics["net_force_cosine"] > COSINE
    assert answer.metrics["false_force_ratio"] < FALSE_FORCE


def test_a_simulation_that_explains_the_clip_worse_is_not_the_answer(recovered: Recover) -> None:
    """One cell across the bar does not carry its swing."""
    assert recovered("bar", "--experiment.cells", "1", "--fit.iterations", "1", *ROUGH).trajectory_error < 0.055
