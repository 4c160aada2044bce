"""Object mask from optical flow alone: strands, holes, and nothing that stands still."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros.bags.read import read_clip
from diffphys_ros.config import build, layered
from diffphys_ros.errors import InputError
from diffphys_ros.segment.flow import flow_mask
from diffphys_ros.segment.likeness import likeness
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


def before_a_plain_wall(mask: np.ndarray, skin: np.ndarray, amplitude_px: float, *, to_one_side: bool) -> Clip:
    """What a mask (H, W) shows of a skin (H, W, 3) swings before a wall without any texture."""
    phase = 2 * np.pi * np.arange(2 * FRAMES) / (2 * FRAMES)
    steps = np.round(amplitude_px * (0.5 - 0.5 * np.cos(phase) if to_one_side else np.sin(phase))).astype(int)
    frames = np.full((2 * FRAMES, HEIGHT, WIDTH, 3), (200, 196, 188), np.uint8)
    for frame, step in zip(frames, steps, strict=True):
        moved = np.roll(mask, step, 1)
        frame[moved] = np.roll(skin, step, 1)[moved]
    return replace(filmed(), frames=frames)


@pytest.mark.parametrize("to_one_side", [False, True])
def test_a_plain_wall_that_the_object_sweeps_over_is_no_piece_of_it(to_one_side: bool) -> None:
    true = shape()
    found = flow_mask(before_a_plain_wall(true, speckles(1, 130)[:, :WIDTH], 8, to_one_side=to_one_side), build({}), NO_MARK) > 0
    assert (found & true).sum() > 0.95 * true.sum()
    assert (found & ~true).sum() < 0.03 * true.sum()  # the hole and the gap between the stems are swept over as well


@pytest.mark.slow
def test_the_bundled_strip_that_swings_wider_than_it_is_ends_at_its_outline() -> None:
    folder = Path(__file__).parents[2] / "bags" / "sample_strip"
    settings = layered([folder / "given.yaml"], {"scene.first_mask": None})
    found = flow_mask(read_clip(folder / "clip.mcap", settings), settings, NO_MARK) > 0
    true = cv2.imread(str(folder / "mask0.png"), cv2.IMREAD_GRAYSCALE) > 0
    assert (found & true).sum() > 0.8 * (found | true).sum()
    near = cv2.dilate(true.astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    assert not (found & ~near).any()  # nor does the floor's edge beside it, a line, come along


def test_still_scenery_seen_through_a_wide_hole_is_no_piece_of_the_object() -> None:
    true = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.ellipse(true, (60, 48), (46, 40), 0, 0, 360, 1, 9)
    clip = before_a_plain_wall(true > 0, speckles(1, 130)[:, :WIDTH], 4, to_one_side=False)
    cv2.putText(clip.frames[0], "shop", (36, 56), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (140, 110, 90), 2)
    clip.frames[:, 36:62, 34:86] = clip.frames[0, 36:62, 34:86]
    found = flow_mask(clip, build({}), NO_MARK) > 0
    assert (found & (true > 0)).sum() > 0.95 * true.sum()
    assert found[36:62, 34:86].mean() < 0.02


def test_what_is_plain_within_the_object_is_no_hole() -> None:
    true, skin = np.zeros((HEIGHT, WIDTH), np.uint8), speckles(1, 130)[:, :WIDTH].copy()
    cv2.ellipse(true, (60, 48), (46, 36), 0, 0, 360, 1, -1)
    cv2.ellipse(skin, (60, 48), (34, 24), 0, 0, 360, (70, 120, 60), -1)
    found = flow_mask(before_a_plain_wall(true > 0, skin, 4, to_one_side=False), build({}), NO_MARK) > 0
    assert (found & (true > 0)).sum() > 0.97 * true.sum()
    assert (found & (true == 0)).sum() < 0.05 * true.sum()


def test_colours_are_told_by_where_they_are_more_frequent() -> None:
    frame = np.full((20, 30, 3), (200, 40, 40), np.uint8)
    frame[:, 10:20], frame[:, 20:] = (40, 40, 200), (40, 200, 40)
    column = np.broadcast_to(np.arange(30), (20, 30))
    found = likeness(frame, column < 5, (column >= 10) & (column < 15))
    assert (found[:, :8] > 1).all()  # of the one side's colour, on its pixels or not
    assert (found[:, 12:18] < -1).all()
    assert np.abs(found[:, 24:]).max() < 0.1  # a colour of neither says nothing
