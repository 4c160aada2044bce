"""Where an object rests that frame 0 shows in motion."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.types import Tracks
from diffphys_ros.vibration.rest import rest_of

FRAMES, POINTS, PERIOD_S = 60, 24, 1 / 30
ALONG = np.linspace(0.02, 0.3, POINTS)
SHAPES = np.stack([(ALONG / 0.3) ** 2, np.sin(np.pi * ALONG / 0.3)])


def tracks_of(sway: np.ndarray, *, noise_m: float = 2e-5) -> Tracks:
    """Points of a beam that move across it (T, POINTS) [m] about its straight shape."""
    points = np.zeros((FRAMES, POINTS, 3))
    points[..., 0] = ALONG
    points[..., 2] = sway
    points += noise_m * np.random.default_rng(0).standard_normal(points.shape)
    return Tracks(points[..., :2] * 1000, points, np.ones((FRAMES, POINTS), bool), True, noise_m, np.zeros((FRAMES, POINTS, 2)))


def two_modes() -> np.ndarray:
    """A swing in which both modes are never near rest at once in the second half of the clip."""
    time = PERIOD_S * np.arange(FRAMES)
    waves = np.exp(-0.3 * time) * np.stack([np.cos(2 * np.pi * 1.3 * time), np.cos(2 * np.pi * 2.6 * time)])
    return np.einsum("kt,kp->tp", waves, [[0.03], [0.012]] * SHAPES)


def test_points_are_put_where_they_rest_though_no_frame_has_them_there() -> None:
    tracks = tracks_of(two_modes())
    assert np.abs(tracks.points[..., 2]).max(1).min() > 0.004
    rest = rest_of(tracks, PERIOD_S)
    assert rest is not None
    still = tracks.points[rest.frame] + rest.offset
    assert np.abs(still[:, 2]).max() < 5e-4


def test_points_of_a_beam_that_shortens_as_it_bends_are_put_on_the_straight_one() -> None:
    """From the nearest frame, a third of the swing away, they move as at rest; as in a bent frame 0 they would go 3 mm along it."""
    sway = 0.03 * np.cos(np.pi / 4 * np.arange(FRAMES) + np.pi / 8)[:, None] * SHAPES[0]
    tracks = tracks_of(sway)
    tracks.points[..., 0] -= 6 * sway**2
    rest = rest_of(tracks, PERIOD_S)
    assert rest is not None
    assert np.abs(sway[rest.frame]).max() > 0.01
    assert np.abs(tracks.points[rest.frame, :, 0] + rest.offset[:, 0] - ALONG).max() < 1e-3


def test_a_clip_that_begins_at_rest_keeps_frame_0() -> None:
    begun = np.maximum(np.arange(FRAMES) - 4, 0)
    sway = 0.04 * np.sin(2 * np.pi * 1.7 * PERIOD_S * begun)
    assert rest_of(tracks_of(sway[:, None] * SHAPES[0]), PERIOD_S) is None


def test_a_clip_whose_swing_is_not_free_is_built_near_its_mean_shape_if_it_begins_far_from_it() -> None:
    push = np.random.default_rng(1).standard_normal(FRAMES)
    far = np.convolve(push, np.hanning(7), "same") * 0.004
    far[0] = 0.06
    rest = rest_of(tracks_of(far[:, None] * SHAPES[0]), PERIOD_S)
    assert rest is not None
    assert rest.frame > 0


def test_a_frame_in_which_most_points_are_lost_is_not_taken() -> None:
    tracks = tracks_of(two_modes())
    first = rest_of(tracks, PERIOD_S)
    assert first is not None
    valid = tracks.valid.copy()
    valid[first.frame, 4:] = False
    other = rest_of(Tracks(tracks.pixels, tracks.points, valid, True, tracks.noise_m), PERIOD_S)
    assert other is not None
    assert other.frame != first.frame


@pytest.mark.parametrize("lost", [0, 3])
def test_offsets_are_those_of_the_points_that_hold_in_that_frame(lost: int) -> None:
    tracks = tracks_of(two_modes())
    valid = tracks.valid.copy()
    valid[1:, :lost] = False
    rest = rest_of(Tracks(tracks.pixels, tracks.points, valid, True, tracks.noise_m), PERIOD_S)
    assert rest is not None
    assert rest.offset.shape == (POINTS - lost, 3)
