"""What is said of a recording that is not what it is taken for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.inverse.doubts import doubts_of
from diffphys_ros.types import Tracks

from .conftest import FRAMES, make_tracks

AT_REST, IN_MOTION = build({"scene.at_rest": True}), build({"scene.at_rest": False})


@pytest.fixture(scope="module")
def filmed(prepared):
    """A clip whose background tells nothing."""
    clip = replace(prepared.clip, labels=np.zeros(prepared.clip.frames.shape[:3], np.uint8))
    return replace(prepared, clip=clip, tracks=make_tracks(prepared.body, prepared.modal, prepared.start))


def shown(tracks: Tracks, chosen: np.ndarray) -> Tracks:
    return replace(tracks, pixels=tracks.pixels[chosen], points=tracks.points[chosen], valid=tracks.valid[chosen])


def doubted(p, chosen: np.ndarray, settings=AT_REST):
    clip = replace(p.clip, frames=p.clip.frames[chosen], labels=p.clip.labels[chosen])
    return doubts_of(clip, shown(p.tracks, chosen), p.body, p.start, settings)


def test_a_sound_clip_leaves_no_doubt(filmed):
    assert doubted(filmed, np.arange(FRAMES)) == ()


def test_frames_that_are_missing_are_doubted_by_the_frame_and_leave_the_stiffness(filmed):
    forced = np.flatnonzero(filmed.start.forced)
    cut = int(forced[0]) + 3
    (doubt,) = doubted(filmed, np.r_[:cut, cut + 5 : FRAMES])
    assert f"between frames {cut - 1} and {cut}" in doubt.text
    assert not doubt.of_young


def test_rest_that_is_told_and_untrue_is_doubted_and_none_told_is_not(filmed):
    late = np.arange(int(np.flatnonzero(filmed.start.forced)[-1]) + 2, FRAMES)
    (doubt,) = doubted(filmed, late)
    assert "scene.at_rest" in doubt.text
    assert doubt.of_young
    assert doubted(filmed, late, IN_MOTION) == ()


def test_of_what_nothing_holds_above_a_floor_the_force_is_doubted_and_not_the_stiffness(filmed):
    free = replace(filmed, body=replace(filmed.body, clamped=False))
    every = np.arange(FRAMES)
    (doubt,) = doubted(free, every, build({"scene.at_rest": True, "scene.floor_z_m": -1.0}))
    assert "floor" in doubt.text
    assert not doubt.of_young
    assert doubted(filmed, every, build({"scene.at_rest": True, "scene.floor_z_m": -1.0})) == ()


def test_what_nobody_says_is_held_and_swings_in_one_place_tells_no_stiffness(filmed):
    unsaid = replace(filmed, body=replace(filmed.body, clamped=False))
    (doubt,) = doubted(unsaid, np.arange(FRAMES))
    assert "something holds it" in doubt.text
    assert doubt.of_young


def test_what_hangs_and_swings_slower_than_a_pendulum_has_other_times_or_another_size(filmed):
    """A phone's slow motion that states the rate at which it is shown."""
    length = float(filmed.body.sides_m[0])
    hangs = replace(filmed, body=replace(filmed.body, gravity=np.array([9.81, 0.0, 0.0])))
    pendulum = np.sqrt(9.81 / length) / (2 * np.pi)
    every, told = np.arange(FRAMES), build({"scene.size_m": length})
    slow = replace(hangs, start=replace(filmed.start, observed_hz=np.array([pendulum / 8])))
    (doubt,) = doubted(slow, every, told)
    assert "set camera.fps" in doubt.text
    assert doubt.of_young
    assert doubted(replace(slow, start=replace(slow.start, observed_hz=np.array([1.2 * pendulum]))), every, told) == ()
    stands = replace(slow, body=replace(filmed.body, gravity=np.array([-9.81, 0.0, 0.0])))
    assert not any("camera.fps" in doubt.text for doubt in doubted(stands, every, told))
