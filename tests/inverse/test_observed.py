"""How large the motion is that the tracks show."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.inverse.observed import displacement_scale, liveliest_acceleration
from diffphys_ros.types import Tracks

PERIOD_S, STEP_M = 1 / 30, 4e-3


def moving(*along_m: float) -> Tracks:
    """Twenty points that stand where they are told at each frame."""
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (1, 20, 3)) + np.array(along_m)[:, None, None] * np.array([1.0, 0, 0])
    return Tracks(np.zeros((*points.shape[:2], 2)), points, np.ones(points.shape[:2], bool), True, 0.0)


def test_a_body_that_leaps_out_of_rest_needs_the_force_of_its_first_frame() -> None:
    """A constant acceleration a takes it by a dt^2 / 2 in a frame, however evenly it then goes on."""
    assert liveliest_acceleration(moving(0, STEP_M, 2 * STEP_M, 3 * STEP_M), PERIOD_S) == pytest.approx(2 * STEP_M / PERIOD_S**2)
    assert liveliest_acceleration(moving(0, STEP_M, 0, 0), PERIOD_S) == pytest.approx(4 * STEP_M / PERIOD_S**2)


def test_points_that_are_lost_in_a_frame_do_not_count_there() -> None:
    tracks = moving(0, STEP_M, 2 * STEP_M, 3 * STEP_M)
    tracks.points[1, 0] += 1.0
    tracks.valid[1, 0] = False
    assert liveliest_acceleration(tracks, PERIOD_S) == pytest.approx(2 * STEP_M / PERIOD_S**2)
    assert displacement_scale(tracks) < 3 * STEP_M


def test_the_displacement_is_the_root_mean_square() -> None:
    assert displacement_scale(moving(0, STEP_M, STEP_M, STEP_M)) == pytest.approx(np.sqrt(0.75) * STEP_M)
