"""How points move as a whole."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from diffphys_ros.rigid_motion import rigid_motion


def test_turn_and_shift_are_found_though_a_fifth_of_the_points_move_otherwise() -> None:
    rng = np.random.default_rng(0)
    points, turn, shift = rng.normal(size=(60, 3)), Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), np.array([0.2, -0.1, 3.0])
    moved = points @ turn.T + shift
    moved[:12] += rng.normal(size=(12, 3))
    found, (before, now) = rigid_motion(points, moved)
    np.testing.assert_allclose(found, turn, atol=1e-4)
    np.testing.assert_allclose(now - found @ before, shift, atol=1e-3)


def test_points_of_a_plane_are_turned_and_never_mirrored() -> None:
    flat = np.column_stack([np.random.default_rng(1).normal(size=(30, 2)), np.zeros(30)])
    mirrored = flat * [-1.0, 1.0, 1.0]
    assert np.linalg.det(rigid_motion(flat, mirrored)[0]) > 0
