"""A clip that begins in motion: the body is built in its pose at rest, and the answer lies where frame 0 has it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from diffphys_ros.inverse import problem
from diffphys_ros.inverse.placement import at_rest, in_body_pose, offset_of_first, shown_at_rest
from diffphys_ros.inverse.prepare import _by_points
from diffphys_ros.progress import finished
from diffphys_ros.types import Clip, Tracks
from diffphys_ros.vibration.rest import Rest
from tests.boxes import bar, bar_settings, box_clip, camera_at, turned

VOLUME_M3 = 0.24 * 0.05 * 0.06
CAMERA = camera_at((0.12, -0.6, 0.0), (0.12, 0, 0))


def swung(angles: np.ndarray) -> Clip:
    """The bar turned about its clamp, towards the camera and away from it, by angles (T,) [rad]."""
    return box_clip(bar(), [turned(angle, axis=2) for angle in angles], CAMERA)


@pytest.fixture(scope="module")
def away() -> Clip:
    """Frame 0 has the free end 35 mm further from the camera than the pose that the bar swings about; no frame is nearer to that than 8 mm."""
    return swung(0.15 * np.cos(np.pi / 8 * np.arange(32)) + 0.05 * (-1.0) ** np.arange(32))


def test_a_body_bent_away_in_frame_0_is_not_taken_for_a_tapered_one(away: Clip) -> None:
    held, _, _, body = finished(_by_points(away, bar_settings()))
    assert body.volume_m3 == pytest.approx(VOLUME_M3, rel=0.04)
    assert held.tracks.first is not None
    assert "built in the pose of frame" in held.clip.notes[-1]


def test_what_is_told_to_rest_in_frame_0_is_built_there(away: Clip) -> None:
    held, _, _, _ = finished(_by_points(away, bar_settings(scene__at_rest=True)))
    assert held.tracks.first is None


def test_what_nothing_holds_is_built_in_frame_0(away: Clip) -> None:
    held, _, _, _ = finished(_by_points(away, bar_settings(scene__clamp_box_m=None)))
    assert held.tracks.first is None


def test_a_bent_view_is_shown_as_it_is_at_rest() -> None:
    bent, still = swung(np.array([0.1, 0.1])), swung(np.zeros(2))
    assert bent.labels is not None
    assert still.labels is not None
    assert still.depth is not None
    assert bent.depth is not None
    mask = bent.labels[0] > 0
    at = bent.camera.backproject(np.argwhere(mask)[::37, ::-1].astype(float), bent.depth[0][mask][::37].astype(float))
    home = at @ np.linalg.inv(turned(0.1, axis=2))[:3, :3].T
    tracks = Tracks(np.zeros((2, len(at), 2)), np.stack([at, at]), np.ones((2, len(at)), bool), True, 1e-4)
    rest = Rest(0, home - at)
    shown, surface = shown_at_rest(bent, np.where(mask, bent.depth[0], 0), at_rest(tracks, rest), rest)
    both = (surface > 0) & (still.labels[0] > 0)
    assert both.sum() > 0.95 * (still.labels[0] > 0).sum()
    assert np.abs(surface - still.depth[0])[both].max() < 3e-3
    assert np.abs(shown.frames[0].astype(float) - still.frames[0])[both].mean() < 0.4 * np.abs(bent.frames[0].astype(float) - still.frames[0])[both].mean()
    assert np.array_equal(shown.frames[1], bent.frames[1])


def test_places_in_frame_0_and_on_the_body_follow_from_each_other(away: Clip) -> None:
    held, _, _, body = finished(_by_points(away, bar_settings()))
    first = held.tracks.first
    assert first is not None
    inner = body.to_world(body.front.points[:: len(body.front.points) // 50])
    back = in_body_pose(held.tracks, inner + offset_of_first(held.tracks, inner))
    assert np.abs(back - inner).max() < 2e-3
    assert np.abs(in_body_pose(held.tracks, first) - held.tracks.points[0]).max() < 1e-3


def test_gaussians_are_bound_where_their_places_are_in_the_pose_that_was_built(away: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    held, _, _, body = finished(_by_points(away, bar_settings()))
    inner = body.to_world(body.front.points[:: len(body.front.points) // 50])
    first, bound = inner + offset_of_first(held.tracks, inner), []
    monkeypatch.setattr(problem.CarriedGaussians, "of", lambda *_, places, **__: bound.append(places))
    prepared = SimpleNamespace(clip=held.clip, tracks=held.tracks, body=body)
    disc = SimpleNamespace(particles=SimpleNamespace(x_rest=body.front.points))
    problem._renderer(prepared, disc, SimpleNamespace(mean=first), held.clip.frames[0], 0, "cpu")
    assert np.abs(first - inner).max() > 0.02
    assert np.abs(bound[0] - inner).max() < 2e-3


def test_a_body_of_frame_0_is_where_it_is() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    tracks = Tracks(np.zeros((2, 5, 2)), np.stack([points, points]), np.ones((2, 5), bool), True, 1e-4)
    assert np.array_equal(in_body_pose(tracks, points), points)
    assert not offset_of_first(tracks, points).any()


def test_tracks_that_count_from_rest_move_as_before() -> None:
    random = np.random.default_rng(1)
    points = random.normal(size=(6, 5, 3))
    valid = np.ones((6, 5), bool)
    valid[4, 3] = False
    kept, offset = np.arange(5) != 3, random.normal(size=(4, 3))
    tracks = Tracks(points[..., :2], points, valid, True, 1e-4, np.zeros((6, 5, 2)))
    other = at_rest(tracks, Rest(4, offset))
    assert other.first is not None
    assert other.sd_m is not None
    assert np.array_equal(other.first, points[0, kept])
    assert np.allclose(other.points[0], points[4, kept] + offset)
    assert np.allclose(other.points - other.points[0], (points - points[0])[:, kept])
    assert other.sd_m.shape == (6, 4, 2)
