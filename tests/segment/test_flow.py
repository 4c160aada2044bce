"""Object mask from optical flow alone: strands, holes, and nothing that stands still."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.errors import InputError
from diffphys_ros.segment.flow import flow_mask
from diffphys_ros.segment.prompt import NO_MARK
from diffphys_ros.types import Camera, Clip

HEIGHT, WIDTH, FRAMES = 96, 128, 8


def speckles(seed: int, mean: float) -> np.ndarray:
    rough = np.random.default_rng(seed).normal(mean, 60, (HEIGHT, WIDTH + 40, 3))
    return np.clip(cv2.GaussianBlur(rough, (0, 0), 1.2) * 1.5 - 0.5 * mean, 0, 255).astype(np.uint8)


def shape() -> np.ndarray:
    """A leaf with a hole on a thin stem, and a second stem beside it."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(mask, (60, 32), (34, 20), 0, 0, 360, 1, -1)
    cv2.ellipse(mask, (60, 32), (13, 9), 0, 0, 360, 0, -1)
    mask[48:84, 56:61] = 1
    mask[44:84, 84:89] = 1
    return mask > 0


def filmed(moves: bool = True) -> Clip:
    """It sways by a few pixels before a scene that stands still."""
    scene, skin, mask = speckles(0, 90)[:, :WIDTH], speckles(1, 160)[:, :WIDTH], shape()
    frames = []
    for k in range(FRAMES):
        step = round(4 * np.sin(2 * np.pi * k / FRAMES)) if moves else 0
        frames.append(np.where(np.roll(mask, step, 1)[..., None], np.roll(skin, step, 1), scene))
    camera = Camera(np.array([[200.0, 0, 63.5], [0, 200.0, 47.5], [0, 0, 1]]), np.eye(4), WIDTH, HEIGHT, "optical", "world")
    return Clip(np.stack(frames), 0, 1 / 30, camera)


def test_a_leaf_with_a_hole_and_two_thin_stems_is_found_as_it_is() -> None:
    found = flow_mask(filmed(), build({}), NO_MARK) > 0
    true = shape()
    assert (found & true).sum() > 0.85 * true.sum()
    assert (found & ~true).sum() < 0.25 * true.sum()
    assert found[60:80, 56:61].mean() > 0.8  # a stem of five pixels
    assert found[60:80, 84:89].mean() > 0.8  # and one that hangs together with the leaf hardly or not
    assert found[29:36, 55:66].mean() < 0.3  # the hole


def test_where_nothing_moves_a_mask_is_asked_for() -> None:
    with pytest.raises(InputError, match=r"0\.00 % of frame 0 is seen to move"):
        flow_mask(filmed(moves=False), build({}), NO_MARK)
