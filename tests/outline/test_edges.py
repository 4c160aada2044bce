"""The outline of a plain strip, whose edges are drawn where they are known to be."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.outline import calm_part, covered, end_of, follow_outline, has_texture, middle, rest_cover, rest_outline
from diffphys_ros.outline.follow import _smooth
from diffphys_ros.plain_swing import plain_swing
from diffphys_ros.segment import plain_labels
from diffphys_ros.types import Clip, Tracks
from tests.boxes import bar_settings
from tests.plain_strips import Strip

STRIP = Strip(frames=60, fps=60.0)


@pytest.fixture(scope="module")
def clip() -> Clip:
    found = STRIP.clip()
    labels = plain_labels(found)
    assert labels is not None
    return found.with_labels(labels)


@pytest.fixture(scope="module")
def calm(clip: Clip) -> Clip:
    calm = calm_part(clip.labels, clip.period_s)
    return clip.part(calm.rest, calm.end)


@pytest.fixture(scope="module")
def tracks(calm: Clip) -> Tracks:
    return follow_outline(calm, np.where(calm.labels[0] > 0, 1.0, 0.0).astype(np.float32))


def sideways(clip: Clip, calm: Clip, tracks: Tracks) -> np.ndarray:
    """True motion (T, M) of the strip along x at the height of each point since the calm part's first frame [px]."""
    first = len(clip) - len(calm)
    sway = STRIP.sway()[first:]
    return (sway - sway[0])[:, None] * STRIP.shape(tracks.pixels[0, :, 1] + STRIP.behind_px)


@pytest.mark.parametrize("damping", [0.0, 0.03])
def test_the_middle_of_a_swing_that_dies_away_is_found_between_its_frames(damping: float) -> None:
    frames = np.arange(75)
    phase = 2 * np.pi * 0.06 * frames + 0.4
    swing = 8.0 * np.exp(-damping * phase) * np.cos(phase)
    moved = np.stack([swing + 0.7, 0.1 * swing - 0.2], 1)
    assert np.abs(swing).min() > 0.1
    np.testing.assert_allclose(middle(moved, 0.06), [0.7, -0.2], atol=0.02)
    np.testing.assert_allclose(middle(moved, 0.0602), [0.7, -0.2], atol=0.03)  # its frequency is not known to better


def test_a_polygon_covers_pixels_by_its_area() -> None:
    share = covered(np.array([[1.25, 0.5], [3.5, 0.5], [3.5, 2.5], [1.25, 2.5]]), (4, 6))
    assert share.sum() == pytest.approx(2.25 * 2)
    assert share[1] == pytest.approx([0, 0.25, 1, 1, 0, 0])


def test_the_plain_strip_is_labelled_in_every_frame(clip: Clip) -> None:
    truth = np.stack([covered(STRIP.outline(sway), STRIP.size) > 0.5 for sway in STRIP.sway()])
    assert ((clip.labels > 0) == truth).mean() > 0.999


def test_rest_is_where_the_strip_hangs_straight_not_where_it_is_still(clip: Clip, calm: Clip) -> None:
    sway = STRIP.sway()
    first = len(clip) - len(calm)
    step = 2 * np.pi * STRIP.hz / STRIP.fps * STRIP.tip_px  # a frame, at the most
    assert abs(sway[first]) < step
    assert np.abs(np.diff(sway))[first] > 0.6 * np.abs(np.diff(sway))[first:].max()


def test_edges_move_as_they_were_drawn_to_a_tenth_of_a_pixel(clip: Clip, calm: Clip, tracks: Tracks) -> None:
    assert tracks.normals is not None
    seen = ((tracks.pixels - tracks.pixels[:1]) * tracks.normals[None, :, :2]).sum(-1)
    across = tracks.normals[:, 0]
    assert tracks.pixels.shape[1] > 20
    assert tracks.valid.mean() > 0.99
    error = seen - sideways(clip, calm, tracks) * across
    assert np.sqrt((error**2).mean()) < 0.1


def test_only_points_that_move_across_themselves_are_kept(tracks: Tracks) -> None:
    assert (np.abs(tracks.normals[:, 0]) > 0.9).all()
    assert tracks.pixels[0, :, 1].max() < STRIP.length_px - STRIP.behind_px - 8
    assert tracks.pixels[0, :, 1].min() > 2


def test_noise_and_blur_do_not_move_the_outline_at_rest(clip: Clip, calm: Clip) -> None:
    noisy = replace(STRIP, noise=5.0).clip().with_labels(clip.labels).part(len(clip) - len(calm), len(clip))
    for one in (calm, noisy):
        outline = rest_outline(one).pixels
        upper = np.abs(outline[:, 1] - 60) < 40
        left, right = (outline[upper & (side * (outline[:, 0] - STRIP.middle_px) > 0), 0].mean() for side in (-1, 1))
        assert right - left == pytest.approx(STRIP.width_px, abs=0.15)
        end = end_of(outline, np.array([[0.0, 0.0], [109.0, 0.0]]))
        assert end == pytest.approx(STRIP.length_px - STRIP.behind_px, abs=0.3)


def test_one_frame_whose_grey_levels_are_off_does_not_widen_the_outline_at_rest(clip: Clip, calm: Clip) -> None:
    """As compression leaves them: seen with a level 15 of 126 too low, the edges of all frames lie further out."""
    frames = calm.frames.copy()
    frames[0] = np.clip(frames[0].astype(int) - 30 * (calm.labels[0] > 0)[..., None], 0, 255)
    soft, spoilt = (blurred(one) for one in (calm, replace(calm, frames=frames)))
    widths = []
    for one in (soft, spoilt):
        outline = rest_outline(one).pixels
        upper = np.abs(outline[:, 1] - 60) < 40
        left, right = (outline[upper & (side * (outline[:, 0] - STRIP.middle_px) > 0), 0].mean() for side in (-1, 1))
        widths.append(right - left)
    assert widths[1] == pytest.approx(widths[0], abs=0.1)


def blurred(clip: Clip) -> Clip:
    """By 1.5 px."""
    return replace(clip, frames=np.stack([cv2.GaussianBlur(frame, (0, 0), 1.5) for frame in clip.frames]))


def test_the_corners_of_the_free_end_belong_to_the_body(clip: Clip, calm: Clip) -> None:
    """Smoothed away they leave a tip that is 10 px^2 too light, and a modulus 2 % too small."""
    noisy = replace(STRIP, noise=5.0).clip().with_labels(clip.labels).part(len(clip) - len(calm), len(clip))
    for one in (calm, noisy):
        cover = rest_cover(one, rest_outline(one))
        assert cover[-60:].sum() == pytest.approx((STRIP.length_px - STRIP.behind_px - (STRIP.size[0] - 60) + 0.5) * STRIP.width_px, abs=5.0)


def test_a_plain_strip_has_no_texture_and_a_speckled_one_has(clip: Clip, calm: Clip) -> None:
    assert not has_texture(clip, 0, bar_settings())
    speckle = np.random.default_rng(1).uniform(-60, 60, (40, 30))
    still = np.repeat(calm.frames[:1], 12, 0).astype(float)
    still[:, 40:120, 40:70] += np.kron(speckle, np.ones((2, 1)))[None, :, :, None]
    textured = replace(calm, frames=np.clip(still, 0, 255).astype(np.uint8), labels=calm.labels[:12] * 0 + calm.labels[:1], observed=None)
    assert has_texture(textured, 0, bar_settings())


def test_too_short_a_swing_is_refused_by_its_periods(clip: Clip) -> None:
    with pytest.raises(InputError, match=r"periods of a swing, needs at least 3\.5"):
        calm_part(clip.labels[:24], clip.period_s)


def test_a_point_that_slides_off_its_edge_is_no_motion_of_the_outline() -> None:
    """It was taken for a second motion, and explained by a force of the strip's weight."""
    swing = 10 * np.cos(np.arange(90) / 5)[:, None] * np.linspace(0.1, 1, 30) + np.random.default_rng(0).normal(0, 0.2, (90, 30))
    seen = swing.copy()
    seen[5:14, 29] = seen[40:46, 29] = 25.0
    left = np.abs(seen - _smooth(seen))
    assert left[5:14, 29].min() > 10
    assert left[40:46, 29].min() > 10
    assert np.median(left[:, :25]) < 0.5


def test_a_swing_too_short_for_calm_frames_is_not_followed_from_a_bent_frame_0() -> None:
    """Taken for rest, it made a film's modulus 3000 times too large at the least."""
    strip = Strip(frames=30, fps=60.0)
    with pytest.raises(InputError, match=r"strip: shows .* periods of a swing, needs at least 3\.5; record a longer free swing"):
        plain_swing(strip.clip(), config.build({}))
    assert plain_swing(strip.clip(), config.build({"scene.at_rest": True})) is None
    pointed_out = np.full(strip.clip().frames.shape[1:3], 255, np.uint8)
    assert plain_swing(replace(strip.clip(), first_labels=pointed_out), config.build({})) is None
    hangs = replace(strip, tip_px=0.0, frames=8).clip()
    pushed = replace(strip, turn=-np.pi / 2).clip()
    assert plain_swing(replace(pushed, frames=np.concatenate([hangs.frames, pushed.frames])), config.build({})) is None


def test_a_strip_before_a_scene_half_of_which_is_as_bright_is_not_taken_with_it(clip: Clip) -> None:
    lit = clip.frames.copy()
    lit[:, 80:] = np.where(np.arange(clip.frames.shape[2])[:, None] < 75, lit[:, 80:], lit.max())
    lit[:, 100:] = lit.max()
    assert plain_labels(replace(clip, frames=lit, labels=None)) is None


def test_nothing_that_stands_still_is_labelled(clip: Clip) -> None:
    assert plain_labels(replace(clip, frames=np.repeat(clip.frames[:1], 8, 0), labels=None)) is None


def test_edges_of_the_scenes_own_grey_are_seen_by_their_colour(clip: Clip, calm: Clip, tracks: Tracks) -> None:
    strip, scene = np.array([200.0, 90.0, 60.0]), np.array([90.0, 126.0, 163.0])  # of one luma
    assert abs((strip - scene) @ [0.299, 0.587, 0.114]) < 0.5
    dark, bright = STRIP.grey
    share = (calm.frames[..., :1].astype(float) - dark) / (bright - dark)
    coloured = replace(calm, frames=np.rint(scene + share * (strip - scene)).astype(np.uint8))
    found = follow_outline(coloured, np.where(calm.labels[0] > 0, 1.0, 0.0).astype(np.float32))
    assert found.normals is not None
    assert found.pixels.shape[1] > 0.8 * tracks.pixels.shape[1]
    seen = ((found.pixels - found.pixels[:1]) * found.normals[None, :, :2]).sum(-1)
    error = seen - sideways(clip, calm, found) * found.normals[:, 0]
    assert np.sqrt((error**2).mean()) < 0.1
