"""Points of an object that turns as it flies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.config import Settings
from diffphys_ros.depth import surface_depth
from diffphys_ros.tracks import LostError, follow
from diffphys_ros.tracks.follow import _without_turn
from diffphys_ros.tracks.turning import turned_back
from diffphys_ros.types import Tracks
from tests.boxes import bar, bar_settings, box_clip, oblique_camera, turned

FRAMES, A_FRAME = 12, 0.09  # rad


def flying() -> list[np.ndarray]:
    return [turned(A_FRAME * k) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def settings() -> Settings:
    told = bar_settings()
    return replace(told, scene=replace(told.scene, clamp_box_m=None, floor_z_m=-1.0, at_rest=False))


@pytest.fixture(scope="module")
def tracks(settings: Settings) -> Tracks | None:
    """None where they are lost."""
    clip = box_clip(bar(), flying(), oblique_camera())
    try:
        return follow(clip, surface_depth(clip, settings)[0], settings)
    except LostError:
        return None


def test_points_are_followed_through_a_turn_of_fifty_degrees(tracks: Tracks | None) -> None:
    assert tracks is not None
    true = np.stack([tracks.points[0] @ pose[:3, :3].T + pose[:3, 3] for pose in flying()])
    assert tracks.valid[-1].mean() > 0.5
    assert np.sqrt(((tracks.points - true)[tracks.valid] ** 2).mean()) < 6e-4  # a pixel is 1.6 mm


def test_the_noise_of_what_turns_is_not_its_turn(tracks: Tracks | None) -> None:
    assert tracks is not None
    assert tracks.noise_m < 5e-4


def test_what_is_turned_back_lies_where_it_was(tracks: Tracks | None) -> None:
    assert tracks is not None
    still = turned_back(tracks.points, tracks.valid)
    assert np.sqrt(((still - still[0])[tracks.valid] ** 2).mean()) < 6e-4
    assert np.sqrt(((tracks.points - tracks.points[0])[-1, tracks.valid[-1]] ** 2).mean()) > 0.02


def test_points_of_what_is_thrown_are_judged_without_its_turn_and_others_as_they_are(settings: Settings) -> None:
    rest = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3))
    points = np.stack([rest @ pose[:3, :3].T for pose in flying()])
    valid = np.ones(points.shape[:2], bool)
    np.testing.assert_allclose(_without_turn(points, valid, settings), np.broadcast_to(rest, points.shape), atol=1e-6)
    assert _without_turn(points, valid, bar_settings()) is points
