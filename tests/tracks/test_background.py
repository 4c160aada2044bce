"""Whether the camera stood still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.tracks import camera_motion

from .filmed import FRAMES, STILL, filmed, pan, plain, shake, tracked, untracked, wall


@pytest.mark.parametrize("shift", [pan(2.4), pan(0.3), shake(0.5), shake(0.5, seed=7)], ids=["pan", "slow pan", "hand", "other hand"])
@pytest.mark.parametrize("sensor", [{"noise": 2.0}, {"noise": 2.0, "drift": True}], ids=["noisy", "drifting"])
def test_a_camera_that_moves_is_noticed_and_the_sentence_says_how_far(shift, sensor):
    found = camera_motion(*filmed(wall(), shift, **sensor))
    assert found is not None
    assert np.abs(found.shift_px + shift[found.frames]).max() < 0.2
    assert "the camera moves" in found.sentence()
    assert "tripod" in found.sentence()


@pytest.mark.slow
@pytest.mark.parametrize("scene", [{}, {"noise": 3.0}, {"shadow": True, "noise": 2.0}, {"branch": True, "noise": 2.0}, {"drift": True, "noise": 2.0}], ids=str)
@pytest.mark.parametrize("ground", [wall, plain], ids=["patterned", "plain"])
def test_a_still_camera_is_not_whatever_else_moves(ground, scene):
    assert camera_motion(*filmed(ground(), STILL, **scene)) is None


def test_a_wall_without_a_mark_tells_nothing():
    assert camera_motion(*filmed(plain(), pan(0.3), noise=2.0)) is None


def test_a_pan_is_noticed_though_a_branch_swings():
    assert camera_motion(*filmed(wall(), pan(0.3), branch=True)) is not None


def test_a_background_that_moves_behind_an_object_that_does_not_is_no_camera():
    clip, _ = filmed(wall(), pan(0.3))
    assert camera_motion(clip, tracked(STILL)) is None


def test_lost_frames_and_lost_tracks_are_stepped_over():
    clip, tracks = filmed(wall(), pan(0.3))
    lost = replace(clip, observed=np.arange(FRAMES) % 3 == 0)
    assert camera_motion(lost, tracks) is not None
    assert camera_motion(clip, untracked(tracks)) is not None
    assert camera_motion(replace(clip, observed=np.arange(FRAMES) == 0), tracks) is None


def test_a_hand_that_shakes_is_noticed_though_every_point_of_the_object_swings_further():
    clip, tracks = filmed(wall(), shake(0.5))
    swing = 4 * np.sin(0.4 * np.arange(FRAMES))[:, None, None] * (1.0, 0.0)
    assert camera_motion(clip, replace(tracks, pixels=tracks.pixels + swing)) is not None
    assert camera_motion(clip, replace(tracked(STILL), pixels=tracked(STILL).pixels + swing)) is None
