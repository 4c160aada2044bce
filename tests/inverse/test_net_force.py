"""What is published of the net force: where, in which frame, and when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.inverse import Prepared, solve
from diffphys_ros.inverse.net_force import with_doubt
from diffphys_ros.types import Doubt, Recovery

from .test_solve import drive

LINEAR = config.build({"scene.at_rest": True, "experiment.schedule": "linear"})
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def answer(prepared: Prepared) -> Recovery:
    return drive(solve(prepared, None, LINEAR))[1]


def test_frames_that_may_carry_a_force_have_a_deviation_and_no_others(prepared: Prepared, answer: Recovery) -> None:
    assert answer.force_identified
    forced = (answer.net_force_sd > 0).all(1)
    np.testing.assert_array_equal(forced, (answer.net_force_sd > 0).any(1))
    np.testing.assert_array_equal(forced, prepared.start.forced)


def test_the_stated_peak_is_that_of_the_published_force_give_or_take_its_deviation(answer: Recovery) -> None:
    largest = np.linalg.norm(answer.net_force(), axis=1).max()
    assert abs(answer.net_force_peak - largest) < 2 * answer.net_force_peak_sd < largest


def test_deviations_turn_with_the_world(prepared: Prepared, answer: Recovery) -> None:
    body, tracks = prepared.body, prepared.tracks
    pose = body.world_from_body.copy()
    pose[:3] = TURN @ pose[:3]
    turned = replace(prepared, body=replace(body, world_from_body=pose), tracks=replace(tracks, points=tracks.points @ TURN.T))
    before = with_doubt(answer, prepared, LINEAR, prepared.start)
    found = with_doubt(replace(answer, force=answer.force @ TURN.T), turned, LINEAR, prepared.start)
    np.testing.assert_allclose(found.net_force_sd, before.net_force_sd[:, [1, 0, 2]], rtol=1e-5)
    assert found.net_force_peak == pytest.approx(before.net_force_peak, rel=1e-5)


def test_of_a_force_that_is_not_identified_nothing_is_stated(prepared: Prepared) -> None:
    doubted = drive(solve(replace(prepared, doubts=(Doubt("the camera moves", of_young=True),)), None, LINEAR))[1]
    assert np.isnan(doubted.net_force_sd).all()
    assert np.isnan([doubted.net_force_peak, doubted.net_force_peak_sd]).all()


def test_a_clip_that_swings_freely_all_along_has_no_force_for_certain(prepared: Prepared, answer: Recovery) -> None:
    free = replace(prepared.start, forced=np.zeros_like(prepared.start.forced))
    found = with_doubt(replace(answer, force=np.zeros_like(answer.force)), prepared, LINEAR, free)
    assert (found.net_force_sd == 0).all()
    assert (found.net_force_peak, found.net_force_peak_sd) == (0.0, 0.0)
