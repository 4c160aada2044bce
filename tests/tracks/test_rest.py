"""Which frame shows an object nearest to rest, and tracks that count from there."""

from __future__ import annotations

import numpy as np

from diffphys_ros.tracks import counted_from, frame_of_rest
from diffphys_ros.types import Tracks

FRAMES, POINTS, HZ, PERIOD_S = 60, 20, 1.7, 1 / 30


def swinging(phase: float) -> Tracks:
    """Points of a beam that swing freely across it, from this phase on (0: at rest, a quarter turn: at the end of its way)."""
    along = np.linspace(0.02, 0.3, POINTS)
    sway = np.sin(2 * np.pi * HZ * PERIOD_S * np.arange(FRAMES) + phase)
    points = np.zeros((FRAMES, POINTS, 3))
    points[..., 0] = along
    points[..., 2] = 0.04 * sway[:, None] * (along / 0.3) ** 2
    return Tracks(points[..., :2] * 1000, points, np.ones((FRAMES, POINTS), bool), True, 1e-4, np.zeros((FRAMES, POINTS, 2)))


def test_a_clip_that_begins_at_the_end_of_a_swing_has_a_frame_nearer_to_rest() -> None:
    tracks = swinging(np.pi / 2)
    found = frame_of_rest(tracks)
    assert found >= FRAMES // 2
    assert np.abs(tracks.points[found, :, 2]).max() < 0.25 * np.abs(tracks.points[0, :, 2]).max()


def test_a_clip_that_begins_at_rest_keeps_frame_0() -> None:
    tracks = swinging(0.0)
    pushed = np.where(np.arange(FRAMES)[:, None, None] < 3, tracks.points[:1], tracks.points)
    assert frame_of_rest(Tracks(tracks.pixels, pushed, tracks.valid, True, 1e-4)) == 0


def test_a_frame_in_which_most_points_are_lost_is_not_taken() -> None:
    tracks = swinging(np.pi / 2)
    valid = tracks.valid.copy()
    valid[frame_of_rest(tracks), 4:] = False
    assert frame_of_rest(tracks) != frame_of_rest(Tracks(tracks.pixels, tracks.points, valid, True, 1e-4)) != 0


def test_tracks_that_count_from_another_pose_move_as_before() -> None:
    tracks = swinging(np.pi / 2)
    valid = tracks.valid.copy()
    valid[40, 3] = False
    other = counted_from(Tracks(tracks.pixels, tracks.points, valid, True, 1e-4, tracks.sd_m), 40)
    kept = np.arange(POINTS) != 3
    assert other.first is not None
    assert np.array_equal(other.first, tracks.points[0, kept])
    assert np.allclose(other.points[0], tracks.points[40, kept])
    assert np.allclose(other.points - other.points[0], (tracks.points - tracks.points[0])[:, kept])
    assert other.sd_m is not None
    assert other.sd_m.shape == (*other.points.shape[:2], 2)
