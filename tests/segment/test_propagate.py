"""Where a pixel came from, and who is right when two masks disagree."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from diffphys_ros.segment.colour import settle_by_colour
from diffphys_ros.segment.interpolate import interpolated_sources
from diffphys_ros.segment.propagate import propagate

SHAPE = (120, 160)


def rectangle(top: int, bottom: int, left: int, right: int) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[top:bottom, left:right] = True
    return mask


def texture(seed: int, colour: tuple[int, int, int], spots: tuple[int, int, int]) -> np.ndarray:
    """Spots on a plain colour, uint8 (H, W, 3)."""
    image = np.full((*SHAPE, 3), colour, np.uint8)
    for u, v in np.random.default_rng(seed).integers(0, SHAPE[::-1], (150, 2)):
        cv2.circle(image, (int(u), int(v)), 2, spots, -1)
    return image


OBJECT, FLOOR = texture(0, (130, 140, 30), (50, 60, 20)), texture(1, (110, 90, 90), (118, 97, 97))


def test_affine_motion_is_continued_without_error() -> None:
    rng = np.random.default_rng(2)
    turn, shift = np.array([[1.02, -0.08], [0.07, 0.97]]), np.array([3.0, -2.0])
    now = rng.uniform([50, 40], [110, 80], (60, 2))
    source = interpolated_sources(now, now @ turn.T + shift, rectangle(36, 84, 46, 114))
    assert source is not None
    pixels = np.argwhere(rectangle(36, 84, 46, 114))
    expected = pixels[:, ::-1] @ turn.T + shift
    assert np.abs(source[pixels[:, 0], pixels[:, 1]] - expected).max() < 0.4  # the rigidity holds slopes back a little


def test_pixels_far_from_the_object_come_from_outside_the_image() -> None:
    now = np.random.default_rng(3).uniform([50, 40], [110, 80], (60, 2))
    source = interpolated_sources(now, now, rectangle(40, 80, 50, 110))
    assert source is not None
    assert np.all(source[5, 5] < 0)


def test_motion_of_fewer_than_eight_points_is_not_continued() -> None:
    assert interpolated_sources(np.zeros((7, 2)), np.zeros((7, 2)), rectangle(0, 9, 0, 9)) is None


@pytest.mark.parametrize("first_is_greedy", [True, False])
def test_colour_finds_the_border_between_a_greedy_and_a_shy_mask(first_is_greedy: bool) -> None:
    true, greedy, shy = rectangle(30, 80, 30, 100), rectangle(30, 95, 30, 100), rectangle(30, 72, 30, 100)
    frame = np.where(true[..., None], OBJECT, FLOOR)
    found = settle_by_colour(frame, *((greedy, shy) if first_is_greedy else (shy, greedy)))
    assert (found ^ true).sum() < 0.02 * true.sum()


def test_masks_that_agree_stay_as_they_are() -> None:
    mask = rectangle(30, 80, 30, 100)
    assert np.array_equal(settle_by_colour(OBJECT, mask, mask), mask)


def test_background_that_the_object_uncovers_is_not_the_object() -> None:
    """An object that rises by 1.5 pixels a frame off a floor that was hidden behind it."""
    frames, masks = [], []
    for k in range(13):
        move = np.array([[1, 0, 0], [0, 1, -1.5 * k]])
        mask = cv2.warpAffine(rectangle(50, 100, 30, 130).astype(np.uint8), move, SHAPE[::-1]) > 0
        frames.append(np.where(mask[..., None], cv2.warpAffine(OBJECT, move, SHAPE[::-1], borderMode=cv2.BORDER_REFLECT), FLOOR))
        masks.append(mask)
    labels = propagate(np.stack(frames), np.ones(13, bool), masks[0].astype(np.uint8))
    for label, mask in zip(labels, masks, strict=True):
        assert ((label > 0) & mask).sum() / ((label > 0) | mask).sum() > 0.99
