"""Evidence of motion, and of standing still beside what moves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from diffphys_ros.segment.motion import motion_mask
from diffphys_ros.segment.movement import Movement
from diffphys_ros.types import Camera, Clip
from tests.boxes import bar_settings

HEIGHT, WIDTH, FRAMES = 120, 180, 14
OBJECT = np.s_[40:80, 30:130]


def cloth(seed: int) -> np.ndarray:
    """A pattern of the same few colours for every seed, RGB (H, W, 3)."""
    noise = np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH)).astype(np.float32)
    shade = cv2.GaussianBlur(noise, (0, 0), 3)
    return (np.clip(shade / shade.std(), -2, 2)[..., None] * np.array([30, 20, 25]) + np.array([95, 130, 105])).astype(np.uint8)


def swinging(behind: np.ndarray, *, held: bool) -> np.ndarray:
    """Frames (T, H, W, 3) of a strip before a scene: it moves up and down as a whole, or is held at its left end and bends."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    true, front = np.zeros((HEIGHT, WIDTH), np.uint8), cloth(1)
    true[OBJECT] = 1
    frames = []
    for k in range(FRAMES):
        move = np.float32(8 * np.sin(0.8 * k)) * (np.clip((u - 30) / 100, 0, 1) ** 2 if held else 1)
        seen, there = (cv2.remap(image, u, v - move, how) for image, how in ((front, cv2.INTER_LINEAR), (true, cv2.INTER_NEAREST)))
        frames.append(np.where(there[..., None] > 0, seen, behind))
    return np.stack(frames)


@pytest.fixture
def true() -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[OBJECT] = True
    return mask


def test_clutter_of_the_objects_colours_beside_it_is_seen_to_stand_still(true: np.ndarray) -> None:
    movement = Movement.of(swinging(cloth(2), held=False))
    still = movement.still(true)
    near = cv2.dilate(true.astype(np.uint8), np.ones((21, 21))) > 0
    assert movement.moving[true].mean() > 0.8
    assert still[near & ~cv2.dilate(true.astype(np.uint8), np.ones((9, 9))).astype(bool)].mean() > 0.3
    assert still[true].mean() < 0.01


def test_a_held_root_is_never_said_to_stand_beside_the_object(true: np.ndarray) -> None:
    movement = Movement.of(swinging(cloth(2), held=True))
    assert not movement.moving[40:80, 30:50].any()
    still = movement.still(true)
    assert not still[40:80, 30:120].any()  # the free end's border mixes with the scene
    assert still[true].mean() < 0.01


def test_of_a_plain_scene_nothing_is_said(true: np.ndarray) -> None:
    plain = np.full((HEIGHT, WIDTH, 3), (95, 130, 105), np.uint8)
    still = Movement.of(swinging(plain, held=False)).still(true)
    assert not still[~cv2.dilate(true.astype(np.uint8), np.ones((9, 9))).astype(bool)].any()


def test_the_still_scene_seen_through_a_moving_ring_is_no_piece_of_it(true: np.ndarray) -> None:
    hole = np.zeros_like(true)
    hole[52:68, 60:100] = True
    frames = swinging(cloth(2), held=False)
    through = [np.roll(hole, round(8 * np.sin(0.8 * k)), 0)[..., None] for k in range(FRAMES)]
    frames = np.where(through, cloth(2), frames)
    camera = Camera(np.array([[200.0, 0, 90], [0, 200, 60], [0, 0, 1]]), np.eye(4), WIDTH, HEIGHT)
    mask = motion_mask(Clip(frames, 0, 1 / 30, camera), bar_settings()) > 0
    assert mask[true & ~hole].mean() > 0.95
    assert mask[hole].mean() < 0.4
    assert mask[~true].mean() < 0.02
