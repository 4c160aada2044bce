"""Leading coordinates of tracks of few frames, and of none that move."""

from __future__ import annotations

import numpy as np

from diffphys_ros.types import Tracks
from diffphys_ros.vibration.coordinates import observe
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
