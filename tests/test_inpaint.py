"""Values where nothing was seen."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from diffphys_ros.inpaint import nearest_known, scene_behind


@pytest.mark.parametrize("shape", [(), (3,)])
def test_an_unknown_pixel_takes_the_value_of_the_nearest_known_one(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    values, known = rng.normal(size=(20, 30, *shape)), rng.uniform(size=(20, 30)) < 0.05
    filled = nearest_known(values, known)
    at = np.argwhere(known)
    for pixel in np.ndindex(20, 30):
        distance = np.linalg.norm(at - pixel, axis=1)
        nearest = at[distance == distance.min()]
        assert any(np.array_equal(filled[pixel], values[tuple(a)]) for a in nearest)
    assert np.array_equal(filled[known], values[known])


def moving_square() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square that passes over a patterned wall: frames, where the wall shows, the wall."""
    wall = np.random.default_rng(1).integers(0, 256, (24, 40, 3), dtype=np.uint8)
    frames, shown = wall[None].repeat(9, 0), np.ones((9, 24, 40), bool)
    for k in range(9):
        frames[k, 6:18, 3 * k : 3 * k + 12], shown[k, 6:18, 3 * k : 3 * k + 12] = 255, False
    return frames, shown, wall


def test_the_scene_behind_is_what_any_frame_shows() -> None:
    frames, shown, wall = moving_square()
    assert np.array_equal(scene_behind(frames, shown), wall)


def test_pixels_that_are_hardly_ever_shown_take_their_neighbours_colours() -> None:
    frames, shown, wall = moving_square()
    shown = shown.copy()
    shown[:, 10, 20] = np.arange(9) == 0
    frames = frames.copy()
    frames[0, 10, 20] = 99
    assert np.array_equal(scene_behind(frames, shown)[10, 20], [99, 99, 99])
    least = scene_behind(frames, shown, least_share=0.2)[10, 20]
    assert any(np.array_equal(least, wall[v, u]) for v, u in ((9, 20), (11, 20), (10, 19), (10, 21)))


def test_a_scene_that_nothing_shows_is_black() -> None:
    frames, shown, _ = moving_square()
    assert not scene_behind(frames, np.zeros_like(shown)).any()


def test_the_scene_behind_takes_little_more_memory_than_its_frames() -> None:
    rng = np.random.default_rng(2)
    frames, shown = rng.integers(0, 256, (15, 240, 320, 3), dtype=np.uint8), rng.uniform(size=(15, 240, 320)) < 0.9
    tracemalloc.start()
    scene = scene_behind(frames, shown)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5 * frames.nbytes
    known = shown.any(0)
    expected = np.nanmedian(np.where(shown[:, known, None], frames[:, known].astype(float), np.nan), 0).astype(np.uint8)
    assert np.array_equal(scene[known], expected)
