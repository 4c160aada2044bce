"""Tracks matched again by patches that turn with the surface."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.matching import Matching, affine_motion, normalised, seed_points, track_pixels
from diffphys_ros.tracks.refine import refined
from diffphys_ros.types import Clip
from tests.boxes import bar, box_clip, oblique_camera, turned

FRAMES, WINDOW = 8, 15
Tracked = tuple[np.ndarray, np.ndarray]


def poses() -> list[np.ndarray]:
    return [turned(0.16 * np.sin(0.6 * k)) for k in range(FRAMES)]


@pytest.fixture(scope="module")
def clip() -> Clip:
    return box_clip(bar(), poses(), oblique_camera())


@pytest.fixture(scope="module")
def rough(clip: Clip) -> Tracked:
    images = [normalised(frame) for frame in clip.frames]
    start = seed_points(images[0], clip.labels[0] > 0, spacing_px=4, most=300)
    return track_pixels(images, start, clip.seen, Matching(WINDOW, 0.4))


@pytest.fixture(scope="module")
def fine(clip: Clip, rough: Tracked) -> Tracked:
    return refined(clip.frames, *rough, clip.labels[0] > 0, window_px=WINDOW)


def misses(clip: Clip, pixels: np.ndarray) -> np.ndarray:
    """Distance [px] (T, M) from where the surface points of frame 0 really are."""
    u, v = pixels[0].astype(int).T
    points = clip.camera.backproject(pixels[0].astype(float), clip.depth[0, v, u].astype(float))
    true = np.stack([clip.camera.project(points @ pose[:3, :3].T + pose[:3, 3])[0] for pose in poses()])
    return np.linalg.norm(pixels - true, axis=-1)


def test_a_turning_surface_is_followed_twice_as_exactly(clip: Clip, rough: Tracked, fine: Tracked) -> None:
    both = rough[1] & fine[1]
    both[0] = False
    before, after = (np.sqrt((misses(clip, pixels)[both] ** 2).mean()) for pixels in (rough[0], fine[0]))
    assert after < 0.5 * before
    assert after < 0.1  # px


def test_more_tracks_hold_than_before(rough: Tracked, fine: Tracked) -> None:
    assert fine[1].mean() >= rough[1].mean()
    assert fine[1].mean() > 0.9


def test_brightness_and_contrast_do_not_matter(clip: Clip, rough: Tracked, fine: Tracked) -> None:
    dimmed = clip.frames.copy()
    dimmed[1:] = np.rint(0.75 * dimmed[1:].astype(float) + 20).astype(np.uint8)
    again = refined(dimmed, *rough, clip.labels[0] > 0, window_px=WINDOW)
    both = fine[1] & again[1]
    assert both.mean() > 0.98 * fine[1].mean()
    assert np.linalg.norm(again[0] - fine[0], axis=-1)[both].max() < 0.1


def test_a_track_whose_patch_is_gone_does_not_hold(clip: Clip, rough: Tracked) -> None:
    covered = clip.frames.copy()
    covered[4, :, 100:140] = np.random.default_rng(0).integers(0, 255, covered[4, :, 100:140].shape)
    valid = refined(covered, *rough, clip.labels[0] > 0, window_px=WINDOW)[1]
    under = (np.abs(rough[0][4, :, 0] - 120) < 12) & rough[1][4]
    assert under.sum() > 10
    assert not valid[4, under].any()


def test_what_is_lost_in_one_frame_comes_back_in_the_next(clip: Clip) -> None:
    images = [normalised(frame) for frame in clip.frames]
    start = seed_points(images[0], clip.labels[0] > 0, spacing_px=4, most=300)
    blind = images.copy()
    blind[2] = blind[2].copy()
    blind[2][:, 120:] = 128  # the free end is out of sight for one frame, while it moves by several pixels
    valid = track_pixels(blind, start, clip.seen, Matching(WINDOW, 0.4))[1]
    usual = track_pixels(images, start, clip.seen, Matching(WINDOW, 0.4))[1]
    end = start[:, 0] > 130
    assert not valid[2, end].any()
    assert valid[3, end].mean() > 0.9 * usual[3, end].mean()


def test_affine_motion_is_exact_for_a_turning_plane() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 200, (300, 2))
    gradient = np.array([[0.02, -0.15], [0.12, -0.03]])
    value, found = affine_motion(points[:50], points, points @ gradient.T + (3, -2))
    assert np.abs(found - gradient).max() < 0.02  # the pull towards no turn at all
    assert np.abs(value - points[:50] @ gradient.T - (3, -2)).max() < 0.5
