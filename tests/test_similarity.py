"""How points move as a whole."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from diffphys_ros.similarity import robust_similarity
from diffphys_ros.types import transformed

SIMILARITY = np.eye(4)
SIMILARITY[:3, :3] = 0.37 * Rotation.from_rotvec([0.4, -1.1, 0.3]).as_matrix()
SIMILARITY[:3, 3] = [1.0, -2.0, 0.5]


def test_a_similarity_is_found_although_a_fifth_of_the_points_is_wrong() -> None:
    rng = np.random.default_rng(0)
    source = rng.normal(size=(20, 3))
    target = transformed(SIMILARITY, source)
    target[:4] += rng.normal(size=(4, 3))
    assert np.allclose(robust_similarity(source, target), SIMILARITY, atol=1e-3)


def test_mirrored_points_get_a_rotation_all_the_same() -> None:
    source = np.random.default_rng(1).normal(size=(10, 3))
    assert np.linalg.det(robust_similarity(source, source * [1, 1, -1])[:3, :3]) > 0


def test_a_rigid_motion_is_found_though_a_fifth_of_the_points_move_otherwise() -> None:
    rng = np.random.default_rng(0)
    points, motion = rng.normal(size=(60, 3)), np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec([0.4, -0.9, 1.3]).as_matrix(), [0.2, -0.1, 3.0]
    moved = transformed(motion, points)
    moved[:12] += rng.normal(size=(12, 3))
    np.testing.assert_allclose(robust_similarity(points, moved, scaled=False), motion, atol=1e-4)


def test_a_rigid_motion_has_no_scale_whatever_the_points_do() -> None:
    points = np.random.default_rng(2).normal(size=(30, 3))
    assert np.linalg.det(robust_similarity(points, 1.3 * points, scaled=False)[:3, :3]) == pytest.approx(1.0)


def test_points_of_a_plane_are_turned_and_never_mirrored() -> None:
    flat = np.column_stack([np.random.default_rng(1).normal(size=(30, 2)), np.zeros(30)])
    mirrored = flat * [-1.0, 1.0, 1.0]
    assert np.linalg.det(robust_similarity(flat, mirrored, scaled=False)[:3, :3]) > 0
    assert np.linalg.det(robust_similarity(flat[:, :2], mirrored[:, :2])[:2, :2]) > 0


def test_a_point_alone_is_shifted() -> None:
    np.testing.assert_allclose(robust_similarity(np.array([[1.0, 2.0]]), np.array([[4.0, 0.0]])), [[1, 0, 3], [0, 1, -2], [0, 0, 1]])
