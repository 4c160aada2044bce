"""Pictures that come again while things move."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.bags.stuck import stuck_frames

COUNT, SIZE = 30, 48


def film(*, rest: int = 5, noise: float = 0.0) -> np.ndarray:
    """A pattern that rests for some frames, then swings, (T, H, W, 3)."""
    rng = np.random.default_rng(0)
    x = np.arange(SIZE)
    away = np.where(np.arange(COUNT) < rest, 0.0, 6 * np.sin(0.6 * (np.arange(COUNT) - rest + 1)) * 0.98 ** np.arange(COUNT))
    rows = 128 + 90 * np.sin(0.4 * (x - away[:, None]))
    frames = np.repeat(np.repeat(rows[:, None, :, None], SIZE, 1), 3, 3)
    return np.clip(np.rint(frames + noise * rng.standard_normal(frames.shape)), 0, 255).astype(np.uint8)


def stuck_in(frames: np.ndarray, observed: np.ndarray | None = None) -> list[int]:
    return np.flatnonzero(stuck_frames(frames, np.ones(len(frames), bool) if observed is None else observed)).tolist()


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_camera_that_hangs_for_some_frames_is_found(noise):
    frames = film(noise=noise)
    frames[15:18], frames[21] = frames[14], frames[20]
    assert stuck_in(frames) == [15, 16, 17, 21]


def test_one_that_hangs_to_the_end_is_found():
    frames = film()
    frames[20:] = frames[19]
    assert stuck_in(frames) == list(range(20, COUNT))


def test_an_object_at_rest_is_not_stuck_nor_one_that_swings():
    assert stuck_in(film(rest=12)) == []
    assert stuck_in(np.repeat(film()[:1], COUNT, 0)) == []
    assert stuck_in(film()[:1]) == []


def test_lost_frames_are_no_stuck_ones():
    frames, observed = film(), np.ones(COUNT, bool)
    observed[14:16], frames[14:16] = False, frames[13]
    assert stuck_in(frames, observed) == []


def test_a_clip_says_how_many_frames_came_again_and_holds_them_for_lost():
    frames = film()
    frames[15:18] = frames[14]
    stamped = [(k * 40_000_000, frame) for k, frame in enumerate(frames)]
    clip = assemble(stamped, [], camera_from_fov(60.0, SIZE, SIZE), "test")
    assert np.flatnonzero(~clip.seen).tolist() == [15, 16, 17]
    assert "3 of 30 frames show the picture before once more" in clip.notes[0]
