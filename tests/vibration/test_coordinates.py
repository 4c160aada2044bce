"""Leading coordinates of tracks of few frames, and of none that move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from diffphys_ros.types import Tracks
from diffphys_ros.vibration.coordinates import LEAST_SHARE, _first_order, _wild, observe
from tests.made_bar import LENGTH, NOISE_M, bar

BODY = bar(pitch=2e-3)
POINTS = np.column_stack([np.linspace(0.02, 0.28, 60), np.tile([-0.03, 0.0, 0.03], 20), np.full(60, 0.0625)])
SHAPE = (POINTS[:, 0] / LENGTH) ** 2


def seen(height: np.ndarray, valid: np.ndarray) -> Tracks:
    """Points that rise by height (T,) [m] at the end of the bar; valid (T, 60)."""
    path = np.repeat(POINTS[None], len(height), 0)
    path[..., 2] += height[:, None] * SHAPE
    path[1:] += NOISE_M * np.random.default_rng(0).standard_normal(path[1:].shape)
    return Tracks(path[..., :2], path, valid, True, NOISE_M)


def test_a_point_seen_in_frames_of_like_height_moves_as_those_beside_it():
    """There the square of the height cannot be told from the height."""
    height, valid = 0.005 * np.sin(np.linspace(0, 2, 12)), np.ones((12, 60), bool)
    valid[1:7, ::7] = False
    motion = observe(BODY, seen(height, valid))
    found = motion.shapes[:, 2, 0] * np.abs(motion.coordinates[:, 0]).max()
    true = np.interp(motion.points[:, 0], POINTS[:, 0], SHAPE) * height.max()
    assert np.abs(np.abs(found) - true).max() < 0.2 * true.max()


def test_points_that_never_move_have_coordinates_and_shapes_of_zero():
    still = Tracks(np.repeat(POINTS[None, :, :2], 9, 0), np.repeat(POINTS[None], 9, 0), np.ones((9, 60), bool), True, NOISE_M)
    motion = observe(BODY, still)
    assert not motion.coordinates.any()
    assert not motion.shapes.any()


def test_what_neighbouring_tracks_are_off_by_alike_is_motion_and_no_track_gone_wrong():
    """Modes miss much about the place of a push; four fifths of the tracks there were left out, and the push was taken for a wind."""
    left = NOISE_M * np.random.default_rng(1).standard_normal((12, 60, 3))
    left[5, :, 2] += 20 * NOISE_M * np.exp(-(((POINTS[:, 0] - 0.15) / 0.06) ** 2))
    left[7, 40, 2] += 20 * NOISE_M
    wild = _wild(POINTS, left, np.ones((12, 60), bool))
    np.testing.assert_array_equal(np.argwhere(wild), [[7, 40]])


def test_motion_of_first_order_has_no_squares_of_the_coordinates_and_no_gaps():
    height, valid = 0.02 * np.sin(np.linspace(0, 9, 40)), np.ones((40, 60), bool)
    valid[11:15, ::7] = False
    curved = seen(height, valid)
    curved.points[..., 0] -= 4 * height[:, None] ** 2 * SHAPE
    curved.points[11:15, ::7] = 0.0
    found = observe(BODY, curved).first_order
    true = height[:, None] * SHAPE
    assert np.abs(found[..., 2] - true).max() < 0.05 * true.max()
    assert np.abs(4 * height[:, None] ** 2 * SHAPE).max() > 1.2e-3
    assert np.abs(found[..., 0]).max() < 0.6e-3


def test_first_and_second_order_are_together_the_tracks_and_what_one_that_was_lost_would_have_shown():
    height, valid = 0.02 * np.sin(np.linspace(0, 9, 40)), np.ones((40, 60), bool)
    valid[5:9, ::7] = False
    curved = seen(height, valid)
    curved.points[..., 0] -= 4 * height[:, None] ** 2 * SHAPE
    true = curved.points - curved.points[:1]
    lost = replace(curved, points=np.where(valid[..., None], curved.points, 0.0))
    found = observe(BODY, lost)
    whole = found.first_order + found.second_order
    np.testing.assert_allclose(whole[found.valid], true[found.valid], atol=1e-12)
    assert np.abs(true[~valid][:, 0]).max() > 1e-3  # of second order
    assert np.abs((whole - true)[~valid]).max() < 1e-4


def begun_bent(seconds: np.ndarray) -> tuple[Tracks, np.ndarray, np.ndarray]:
    """Points that swing about rest as the bar does, up and sideways at their own frequencies, and are drawn in along it by the square of the height; frame 0 is bent upwards.
    Also the true motions of first order (T, 60), up and sideways."""
    up, aside = 0.02 * np.cos(2 * np.pi * 3.1 * seconds), 0.008 * np.sin(2 * np.pi * 5.3 * seconds) + 0.004 * np.cos(2 * np.pi * 3.1 * seconds)
    path = np.repeat(POINTS[None], len(seconds), 0)
    path[..., 2] += up[:, None] * SHAPE
    path[..., 1] += aside[:, None] * SHAPE
    path[..., 0] -= 6 * up[:, None] ** 2 * SHAPE
    path += NOISE_M * np.random.default_rng(2).standard_normal(path.shape)
    tracks = Tracks(path[..., :2], path - path[:1] + POINTS, np.ones(path.shape[:2], bool), True, NOISE_M, first=path[0])
    return tracks, up[:, None] * SHAPE, aside[:, None] * SHAPE


def test_a_motion_that_begins_bent_keeps_both_of_its_coordinates():
    """About frame 0 principal coordinates move together, which is no second order: a plate's sideways mode was left out for it, and E came out 1.8 times too soft."""
    tracks, _, aside = begun_bent(np.arange(40) / 30)
    motion = observe(BODY, tracks)
    assert motion.coordinates.shape[1] == 2
    found = motion.first_order[..., 1]
    true = aside - aside[:1]
    assert np.abs(found - true).max() < 0.06 * np.abs(true).max()


def test_shapes_of_a_motion_that_begins_bent_are_those_at_rest():
    """Squares of the motion from a bent frame 0 lie along the shapes as well: there the bar's tip is drawn in by .05 of what it rises."""
    tracks, up, _ = begun_bent(np.arange(40) / 30)
    motion = observe(BODY, tracks)
    along, rise = motion.first_order[..., 0], up - up[:1]
    slope = (along * rise).sum() / (rise**2).sum()
    assert abs(slope) < 0.01
    bent = replace(tracks, first=None)
    assert abs((observe(BODY, bent).first_order[..., 0] * rise).sum() / (rise**2).sum()) > 0.1


def test_a_coordinate_that_hardly_moves_but_with_the_first_is_left_out():
    """It would be noise with a shape of its own."""
    seconds = np.arange(60) / 30
    first, own = np.sin(2 * np.pi * 1.7 * seconds), np.sin(2 * np.pi * 4.3 * seconds)
    shares = [0.3 * LEAST_SHARE, 3 * LEAST_SHARE]
    assert [_first_order(np.column_stack([first, 0.4 * first + share * own]), floor=0.0) for share in shares] == [[0], [0, 1]]
