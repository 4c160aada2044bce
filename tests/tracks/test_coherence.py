"""Wrong positions and frame 0's error in depth, told by the motion that all tracks share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.tracks.coherence import _refitted, settled, shared_motion
from diffphys_ros.types import Camera, Clip

FRAMES, SIGMA = 50, 1e-3
CAMERA = Camera(np.array([[500.0, 0, 319.5], [0, 500.0, 239.5], [0, 0, 1]]), np.eye(4), 640, 480)


def sheet() -> np.ndarray:
    """True positions (T, M, 3) [m] of a sheet that bends and twists a metre before the camera, at rest in the first three frames."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 0.3, 25), np.linspace(-0.05, 0.05, 9)))
    t = np.maximum(np.arange(FRAMES) - 2, 0)[:, None]
    bend, twist = 0.03 * np.sin(0.35 * t) * (x / 0.3) ** 2, 0.2 * np.sin(0.61 * t) * y * x / 0.3
    return np.stack([x - 0.4 * bend**2, y + 0.5 * bend, 1 + bend + twist], -1)


def seen(points: np.ndarray) -> Clip:
    depth = np.zeros((FRAMES, 2, 2), np.float32)
    return Clip(np.zeros((FRAMES, 2, 2, 3), np.uint8), 0, 1 / 30, CAMERA, depth)


def noisy(points: np.ndarray) -> np.ndarray:
    """Depth (z) read with an error of its own in every frame."""
    return points + np.random.default_rng(1).normal(0, SIGMA, points.shape) * (0.1, 0.1, 1)


def test_the_depth_of_frame_zero_is_corrected_by_all_frames() -> None:
    true, valid = sheet(), np.ones((FRAMES, 225), bool)
    points, _ = settled(seen(true), noisy(true), valid)
    before, after = (np.sqrt(((p[0] - true[0])[:, 2] ** 2).mean()) for p in (noisy(true), points))
    assert after < 0.6 * before
    assert np.array_equal(points[1:], noisy(true)[1:])
    ray = points[0] / points[0, :, 2:]
    assert np.abs(ray - noisy(true)[0] / noisy(true)[0, :, 2:]).max() < 1e-12  # along its line of sight alone


@pytest.mark.parametrize("offset_m", [0.02, 0.035])
def test_a_patch_that_sticks_to_something_else_does_not_hold(offset_m: float) -> None:
    true, valid = noisy(sheet()), np.ones((FRAMES, 225), bool)
    wrong = np.zeros((FRAMES, 225), bool)
    wrong[30:41, 100:105] = True
    true[wrong] += (0, offset_m, 0)
    kept = settled(seen(true), true, valid)[1]
    assert not kept[wrong].any()
    assert kept[~wrong].mean() > 0.999


def test_a_frame_in_which_hardly_a_track_holds_says_nothing() -> None:
    true, valid = noisy(sheet()), np.ones((FRAMES, 225), bool)
    valid[20, 9:] = False
    assert not settled(seen(true), true, valid)[1][20].any()


def test_frames_that_were_lost_are_no_part_of_the_fit() -> None:
    true, valid = noisy(sheet()), np.ones((FRAMES, 225), bool)
    received = np.ones(FRAMES, bool)
    received[[7, 8]] = False
    broken = true.copy()
    broken[[7, 8]], valid[[7, 8]] = broken[6], False
    found = shared_motion(broken, valid, received)
    assert found.scale < 1.6 * SIGMA
    assert not found.plausible[[7, 8]].any()


def test_a_handful_of_tracks_comes_back_as_it_is() -> None:
    true, valid = noisy(sheet())[:, :30], np.ones((FRAMES, 30), bool)
    points, kept = settled(seen(true), true, valid)
    assert points is true
    assert kept is valid


def test_without_a_depth_topic_frame_zero_stays() -> None:
    true, valid = noisy(sheet()), np.ones((FRAMES, 225), bool)
    points, _ = settled(replace(seen(true), depth=None), true, valid)
    assert np.array_equal(points, true)


def test_a_frame_unlike_all_others_keeps_its_tracks() -> None:
    """What most tracks of a frame do alike is motion, however far it lies from that of the other frames."""
    true, valid = noisy(sheet()), np.ones((FRAMES, 225), bool)
    true[30] = true[0] + 2.5 * (noisy(sheet())[30] - true[0])
    assert settled(seen(true), true, valid)[1][30].mean() > 0.95


def test_frames_in_which_no_track_holds_and_points_that_do_not_move_are_borne() -> None:
    still = np.repeat(sheet()[:1], FRAMES, 0)
    for points in (still, sheet()):
        valid = np.ones(points.shape[:2], bool)
        valid[7, 5:], valid[8] = False, False
        _, kept = settled(seen(points), points, valid)
        assert kept[0].all()
        assert not kept[8].any()


def test_a_frame_in_which_all_that_holds_stands_where_it_was_has_no_singular_fit() -> None:
    shapes = np.zeros((50, 3, 3))  # of tracks that do not move
    assert np.isfinite(_refitted(shapes, np.zeros((8, 50, 3)), np.ones((8, 50), bool))).all()
