"""Whether clock and start are what they are said to be: what is missing or moves already is told from what is pushed, lost or seen wrongly."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.modes.response import Step, convolve
from diffphys_ros.vibration.continuity import jump_after, moving_at_first, swings_off_rest

PERIOD_S, FRAMES = 1 / 30, 60
HZ, DECAY = np.array([1.9, 2.8]), np.array([0.1, 0.25])
COMMON, NOISE = 3e-5, 6e-5  # m
MIXED = np.array([[0.9, 0.1], [-0.2, 0.8]])


def swings(force: np.ndarray, *, start: np.ndarray | None = None, seed: int = 0) -> np.ndarray:
    """Coordinates (T, 2) [m] of two oscillators under a force (T, 2), from rest or from a state (2, 2)."""
    step = Step.of((2 * np.pi * HZ) ** 2, DECAY, PERIOD_S)
    q = convolve(step.pulse(FRAMES), force) + (0.0 if start is None else step.history(start, FRAMES))
    q = q @ MIXED + COMMON * np.random.default_rng(seed).standard_normal((FRAMES, 2))
    return q - q[0]


def pushed(first: int, last: int, peak: float = 1.2) -> np.ndarray:
    """One half-sine over frames first..last."""
    force = np.zeros((FRAMES, 2))
    count = last - first + 1
    force[first : last + 1] = peak * np.sin(np.pi * (np.arange(count) + 0.5) / count)[:, None] * (1.0, 0.7)
    return force


def jump(q: np.ndarray, known: np.ndarray | None = None) -> int | None:
    return jump_after(q, np.ones(len(q), bool) if known is None else known, at_rest=True, noise_m=NOISE, common_m=COMMON)


def without(q: np.ndarray, first: int, count: int) -> np.ndarray:
    return np.delete(q, np.arange(first, first + count), 0)


@pytest.mark.parametrize("first", [5, 7, 12, 20, 30, 41])
@pytest.mark.parametrize("count", [5, 8])
def test_frames_cut_out_under_continuous_stamps_are_found_at_the_cut(first, count):
    assert jump(without(swings(pushed(3, 10)), first, count)) == first - 1


def test_a_single_frame_that_is_cut_out_is_found_where_the_recursion_shows_it():
    """Three of four; the gap itself, half a step wide, shows in one of five."""
    firsts = range(5, 45, 2)
    found = [jump(without(swings(pushed(3, 10)), first, 1)) for first in firsts]
    assert set(found) <= {None, *(first - 1 for first in firsts)}
    assert np.mean([place is not None for place in found]) > 0.5


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("first", "last"), [(3, 3), (3, 4), (10, 11), (3, 8), (3, 23)])
def test_a_push_however_sharp_is_no_cut(first, last, seed):
    assert jump(swings(pushed(first, last, peak=6.0 / (last - first + 1)), seed=seed)) is None


def test_a_hammer_between_two_frames_is_no_cut():
    struck = swings(np.zeros((FRAMES, 2)), start=np.array([[0.0, 0.0], [0.3, 0.2]]))[: FRAMES - 9]
    for share in (0.0, 0.3, 0.9):  # of the frame that the blow falls in
        late = np.arange(len(struck) - 1) + share
        moved = np.stack([np.interp(late, np.arange(len(struck)), column) for column in struck.T], 1)
        assert jump(np.vstack([COMMON * np.random.default_rng(1).standard_normal((9, 2)), moved])) is None


def test_a_lost_frame_that_the_stamps_show_and_one_seen_wrongly_are_no_cuts():
    q, known = swings(pushed(3, 10)), np.ones(FRAMES, bool)
    known[[17, 18, 33]] = False
    q[~known] = q[np.flatnonzero(~known) - 1]
    assert jump(q, known) is None
    wrong = swings(pushed(3, 10))
    wrong[25] += (0.004, -0.003)
    assert jump(wrong) is None


def test_gusts_without_end_and_a_body_at_rest_are_no_cuts():
    rng = np.random.default_rng(2)
    gusts = np.repeat(rng.standard_normal((FRAMES // 4, 2)), 4, 0)
    assert jump(swings(gusts)) is None
    assert jump(COMMON * rng.standard_normal((FRAMES, 2))) is None


def test_a_clip_too_short_to_tell_tells_nothing():
    assert jump(swings(pushed(1, 3))[:5]) is None


def begun(frame: int) -> np.ndarray:
    """The clip without its first frames, measured from what is then the first."""
    q = swings(pushed(3, 10))[frame:]
    return q - q[0]


@pytest.mark.parametrize("frame", [5, 8, 13])
def test_a_clip_that_begins_in_motion_is_noticed_where_rest_is_told(frame):
    q = begun(frame)
    known = np.ones(len(q), bool)
    assert moving_at_first(q, known, common_m=COMMON) or swings_off_rest(q, known, HZ[0], PERIOD_S, noise_m=NOISE)


def test_a_clip_that_begins_at_a_turning_point_swings_about_another_shape():
    whole = swings(pushed(3, 10))
    still = 12 + int(np.linalg.norm(np.diff(whole[12:40], axis=0), axis=1).argmin())
    q = begun(still)
    assert swings_off_rest(q, np.ones(len(q), bool), HZ[0], PERIOD_S, noise_m=NOISE)


@pytest.mark.parametrize("first", [0, 1, 3])
def test_a_force_that_sets_in_at_once_leaves_frame_0_at_rest(first):
    q, known = swings(pushed(first, first + 7)), np.ones(FRAMES, bool)
    assert not moving_at_first(q, known, common_m=COMMON)
    assert not swings_off_rest(q, known, HZ[0], PERIOD_S, noise_m=NOISE)
