"""Exposure drift: read off the still part of the picture, taken off, and left alone where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.bags.exposure import exposure_gains, with_steady_exposure

FRAMES, HEIGHT, WIDTH = 12, 120, 160


def scene(*, object_share: float = 0.25) -> np.ndarray:
    """A textured wall, still, before which a textured object slides by ten pixels a frame; levels 30..200, (T, H, W, 3)."""
    rng = np.random.default_rng(0)
    wall, thing = (np.kron(rng.uniform(30, 200, (HEIGHT // 4, WIDTH // 4, 3)), np.ones((4, 4, 1))) for _ in range(2))
    frames, width = np.repeat(wall[None], FRAMES, 0), int(object_share * WIDTH)
    for k in range(FRAMES):
        left = min(10 * k, WIDTH - width)
        frames[k, :, left : left + width] = np.roll(thing, 7 * k, 1)[:, :width]
    return frames


def drift() -> np.ndarray:
    """Gains over frame 0, (T, 3): exposure and white balance."""
    t = np.arange(FRAMES)[:, None]
    return np.exp(0.08 * np.sin(0.5 * t) + 0.02 * np.sin(np.array([0.2, 0.3, 0.4]) * t))


def filmed(levels: np.ndarray, gains: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(1).normal(0, 2, levels.shape)
    return np.clip(np.rint(levels * gains[:, None, None] + noise), 0, 255).astype(np.uint8)


def test_gains_are_found_within_a_third_of_a_percent_although_an_object_moves() -> None:
    assert np.abs(exposure_gains(filmed(scene(), drift())) - drift()).max() < 0.0033


def test_frames_come_back_as_frame_zero_was_exposed() -> None:
    levels = scene()
    steady, largest = with_steady_exposure(filmed(levels, drift()))
    assert largest == pytest.approx(np.abs(drift() - 1).max(), abs=0.004)
    assert np.abs(steady.mean((1, 2)) - levels.mean((1, 2))).max() < 0.5  # grey levels
    assert np.abs(filmed(levels, drift()).mean((1, 2)) - levels.mean((1, 2))).max() > 8


def test_a_clip_without_drift_keeps_its_bytes() -> None:
    clip = filmed(scene(), np.ones((FRAMES, 3)))
    steady, largest = with_steady_exposure(clip)
    assert largest == 0
    assert steady is clip


def test_taking_the_drift_off_twice_is_taking_it_off_once() -> None:
    once = with_steady_exposure(filmed(scene(), drift()))[0]
    again, largest = with_steady_exposure(once)
    assert largest == 0
    assert np.array_equal(once, again)


def test_a_picture_that_changes_everywhere_is_left_as_it_is() -> None:
    clip = filmed(scene(object_share=0.9), drift())
    assert exposure_gains(clip) is None
    assert with_steady_exposure(clip)[0] is clip


def test_saturated_and_black_surroundings_say_nothing() -> None:
    clip = filmed(scene(), drift())
    clip[:, :, : WIDTH // 2] = 255
    clip[:, :, WIDTH // 2 :] = 0
    assert exposure_gains(clip) is None


def test_a_clip_tells_that_drift_was_taken_off() -> None:
    frames = filmed(scene(object_share=0.1), drift())
    clip = assemble([(k * 33_000_000, frame) for k, frame in enumerate(frames)], [], camera_from_fov(60.0, WIDTH, HEIGHT), "test")
    assert any("exposure drifted by up to" in note for note in clip.notes)
    assert np.abs(clip.frames[:, -20:, -8:].astype(float) - clip.frames[0, -20:, -8:]).mean() < 4
