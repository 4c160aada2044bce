"""Claims about labels of a plain object."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.matching import Matching
from diffphys_ros.plainness import plain
from diffphys_ros.segment import label_clip
from diffphys_ros.segment.even import labels_by_colour
from diffphys_ros.types import Clip

HEIGHT, WIDTH, FRAMES = 90, 160, 10
LEAF, STEM = (196, 120, 40), (90, 130, 60)
STROKES = tuple((x, y, *size) for x in (250, 275, 300) for y, size in ((38, (14, 4)), (58, (4, 16)), (84, (16, 4)), (104, (4, 10))))  # left, top, width, height [px]
MATCHING = Matching(window_px=15, round_trip_px=0.4)


def truth(k: int) -> np.ndarray:
    """Labels (H, W) of frame k: a stem and a leaf that goes down, past it."""
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[40 + k : 50 + k, 20:60] = 1
    labels[10 + 4 * k : 40 + 4 * k, 60:110] = 2
    return labels


def scene() -> np.ndarray:
    """A wall over a floor of another colour, both with a gradient."""
    shade = np.linspace(0, 30, WIDTH)[None, :, None]
    ground = np.where(np.arange(HEIGHT)[:, None, None] < 55, (120, 125, 110), (85, 95, 115))
    return np.broadcast_to(ground + shade, (HEIGHT, WIDTH, 3))


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """With a faint noise, and shading along the leaf."""
    rng, made = np.random.default_rng(0), []
    for k in range(FRAMES):
        labels = truth(k)[..., None]
        light = 1 + 0.15 * np.linspace(-1, 1, HEIGHT)[:, None, None]
        shown = np.where(labels == 1, np.array(STEM) * light, np.where(labels == 2, np.array(LEAF) * light, scene()))
        made.append(shown + rng.normal(0, 1.0, shown.shape))
    return np.clip(np.rint(made), 0, 255).astype(np.uint8)


def test_a_plain_object_is_found_in_every_frame_with_its_parts(frames: np.ndarray) -> None:
    found = labels_by_colour(frames, np.ones(FRAMES, bool), truth(0))
    assert found is not None
    for k, labels in enumerate(found):
        assert ((labels > 0) & (truth(k) > 0)).sum() > 0.96 * ((labels > 0) | (truth(k) > 0)).sum()
        assert (labels == truth(k)).mean() > 0.985


def test_frames_that_were_not_received_repeat_the_labels_before_them(frames: np.ndarray) -> None:
    seen = np.ones(FRAMES, bool)
    seen[4] = False
    found = labels_by_colour(frames, seen, truth(0))
    assert found is not None
    assert np.array_equal(found[4], found[3])
    assert not np.array_equal(found[5], found[3])


def test_an_object_of_the_scenes_colours_is_not_told_by_them(frames: np.ndarray) -> None:
    hidden = frames.copy()
    for k in range(FRAMES):
        hidden[k][truth(k) > 0] = scene().astype(np.uint8)[truth(k) > 0]
    assert labels_by_colour(hidden, np.ones(FRAMES, bool), truth(0)) is None


def test_a_painted_surface_is_plain_and_a_patterned_one_is_not(frames: np.ndarray) -> None:
    pattern = np.random.default_rng(1).integers(-25, 25, (FRAMES, HEIGHT // 2, WIDTH // 2, 1)).repeat(2, 1).repeat(2, 2)
    assert plain(frames, truth(0) > 0, MATCHING, spacing_px=4)
    assert not plain(np.clip(frames + pattern, 0, 255).astype(np.uint8), truth(0) > 0, MATCHING, spacing_px=4)


def test_a_surface_with_a_few_strokes_is_not_plain(frames: np.ndarray) -> None:
    """Most of it is flat, yet what is on it can be followed."""
    drawn, mask = frames.repeat(3, 1).repeat(3, 2), (truth(0) > 0).repeat(3, 0).repeat(3, 1)
    for k in range(FRAMES):
        for x, y, across, down in STROKES:
            drawn[k][y + 12 * k : y + 12 * k + down, x : x + across] = 20
    assert (drawn[0][mask].max(1) < 40).mean() < 0.06
    assert not plain(drawn, mask, MATCHING, spacing_px=4)


@pytest.mark.parametrize(("grey", "is_plain"), [(2, True), (12, False)])
def test_what_compression_leaves_on_a_plain_surface_is_no_texture_though_it_moves_along(frames: np.ndarray, grey: int, is_plain: bool) -> None:
    pattern = np.random.default_rng(1).integers(-grey, grey + 1, (45, 50, 1)).repeat(3, 0).repeat(3, 1)
    drawn, mask = frames.repeat(3, 1).repeat(3, 2).astype(int), (truth(0) > 0).repeat(3, 0).repeat(3, 1)
    drawn[:] = drawn[0]
    for k in range(FRAMES):
        drawn[k, 30 + 3 * k : 165 + 3 * k, 180:330] = np.array(LEAF) + pattern
    mask[:, :180] = False
    assert plain(np.clip(drawn, 0, 255).astype(np.uint8), mask, MATCHING, spacing_px=4) == is_plain


def test_a_patterned_object_that_leaps_is_not_plain(frames: np.ndarray) -> None:
    """None of its points is found again, for it is elsewhere."""
    pattern = np.random.default_rng(1).integers(-25, 25, (HEIGHT // 2, WIDTH // 2, 1)).repeat(2, 0).repeat(2, 1)
    shown = np.clip(frames[0] + pattern, 0, 255).astype(np.uint8)
    gone = np.stack([shown] + [np.roll(shown, 60, axis=1)[::-1]] * (FRAMES - 1))
    assert not plain(gone, truth(0) > 0, MATCHING, spacing_px=4)


def test_noise_of_a_camera_is_no_texture(frames: np.ndarray) -> None:
    noisy = np.clip(frames + np.random.default_rng(1).normal(0, 3.0, frames.shape), 0, 255).astype(np.uint8)
    assert plain(noisy, truth(0) > 0, MATCHING, spacing_px=4)


def test_a_clip_of_a_plain_object_is_labelled_by_its_colours(frames: np.ndarray) -> None:
    clip = Clip(frames, 0, 1 / 30, camera_from_fov(50.0, WIDTH, HEIGHT), first_labels=truth(0))
    labels = label_clip(clip, config.build({}))
    assert ((labels > 0) == np.stack([truth(k) > 0 for k in range(FRAMES)])).mean() > 0.99


def test_a_mask_that_holds_nothing_is_not_plain(frames: np.ndarray) -> None:
    assert not plain(frames, np.zeros((HEIGHT, WIDTH), bool), MATCHING, spacing_px=4)
