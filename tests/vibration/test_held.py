"""What is held is told from what is free by the middle of its points."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.vibration.coordinates import Motion
from diffphys_ros.vibration.held import swings_as_a_whole

FRAMES = 40
ALONG = np.linspace(0.0, 1.0, 60)
HELD = ALONG**2 * (6 - 4 * ALONG + ALONG**2)  # a bar under its weight, about its first mode held at one end
BETWEEN = ALONG - 0.5
FREE = np.cos(2 * np.pi * BETWEEN) - np.cos(2 * np.pi * BETWEEN).mean()  # about the first mode of a free one


def swinging(*shapes: np.ndarray, q: np.ndarray) -> Motion:
    """A bar along x that moves along z by shapes (60,) with amplitudes q (T, n)."""
    fields = np.zeros((len(ALONG), 3, len(shapes)))
    fields[:, 2] = np.stack(shapes, 1)
    nothing = np.zeros((FRAMES, len(ALONG), 3))
    points = np.stack([ALONG, 0 * ALONG, 0 * ALONG], 1)
    return Motion(points, q, fields, None, np.ones(FRAMES, bool), 1e-5, nothing, np.ones((FRAMES, len(ALONG)), bool))


@pytest.fixture
def swing() -> np.ndarray:
    return 1e-2 * np.sin(2 * np.pi * np.arange(FRAMES) / 11)


def test_a_bar_held_at_one_end_swings_as_a_whole_and_a_free_one_does_not(swing) -> None:
    assert swings_as_a_whole(swinging(HELD, q=swing[:, None]), np.zeros(FRAMES, bool))
    assert not swings_as_a_whole(swinging(FREE, q=swing[:, None]), np.zeros(FRAMES, bool))


def test_what_falls_does_not_swing(swing) -> None:
    fall = 0.5 * 9.81 * (np.arange(FRAMES) / 30) ** 2 - 0.3 * np.arange(FRAMES) / 30
    assert not swings_as_a_whole(swinging(np.ones(60), FREE, q=np.stack([fall, swing], 1)), np.zeros(FRAMES, bool))


def test_what_a_force_moves_as_a_whole_says_nothing(swing) -> None:
    pushed = np.where(np.arange(FRAMES) < 20, 1e-2 * np.sin(np.arange(FRAMES)), 1e-2 * np.sin(19) + 1e-2 * np.cos(19) * (np.arange(FRAMES) - 19))
    motion = swinging(np.ones(60), FREE, q=np.stack([pushed, swing], 1))
    assert swings_as_a_whole(motion, np.zeros(FRAMES, bool))
    assert not swings_as_a_whole(motion, np.arange(FRAMES) < 20)


def test_too_few_free_frames_say_nothing(swing) -> None:
    assert not swings_as_a_whole(swinging(HELD, q=swing[:, None]), np.arange(FRAMES) < FRAMES - 7)
