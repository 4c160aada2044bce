"""A clip that begins in motion: the body is built where it is nearest to rest, and the answer lies where frame 0 has it."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.inverse.placement import in_body_pose, offset_of_first
from diffphys_ros.inverse.prepare import _by_points
from diffphys_ros.progress import finished
from diffphys_ros.tracks import counted_from
from diffphys_ros.types import Clip, Tracks
from tests.boxes import bar, bar_settings, box_clip, camera_at, turned

VOLUME_M3 = 0.24 * 0.05 * 0.06


@pytest.fixture(scope="module")
def away() -> Clip:
    """Frame 0 has the free end 35 mm further from the camera than the pose that the bar swings about."""
    poses = [turned(0.15 * np.cos(np.pi / 8 * k), axis=2) for k in range(32)]
    return box_clip(bar(), poses, camera_at((0.12, -0.6, 0.0), (0.12, 0, 0)))


def test_a_body_bent_away_in_frame_0_is_not_taken_for_a_tapered_one(away: Clip) -> None:
    held, _, _, body = finished(_by_points(away, bar_settings()))
    assert body.volume_m3 == pytest.approx(VOLUME_M3, rel=0.04)
    assert held.tracks.first is not None
    assert "built in the pose of frame" in held.clip.notes[-1]


def test_what_is_told_to_rest_in_frame_0_is_built_there(away: Clip) -> None:
    held, _, _, _ = finished(_by_points(away, bar_settings(scene__at_rest=True)))
    assert held.tracks.first is None


def test_places_in_frame_0_and_on_the_body_follow_from_each_other(away: Clip) -> None:
    held, _, _, body = finished(_by_points(away, bar_settings()))
    first = held.tracks.first
    assert first is not None
    inner = body.to_world(body.front.points[:: len(body.front.points) // 50])
    back = in_body_pose(held.tracks, inner + offset_of_first(held.tracks, inner))
    assert np.abs(back - inner).max() < 2e-3
    assert np.abs(in_body_pose(held.tracks, first) - held.tracks.points[0]).max() < 1e-3


def test_a_body_of_frame_0_is_where_it_is() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    tracks = Tracks(np.zeros((2, 5, 2)), np.stack([points, points]), np.ones((2, 5), bool), True, 1e-4)
    assert np.array_equal(in_body_pose(tracks, points), points)
    assert not offset_of_first(tracks, points).any()
    assert counted_from(tracks, 1).first is not None
