"""How frames lie over frame 0 is found as surely as is said, and a hand does not hide what moves before a wall."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from diffphys_ros.config import build
from diffphys_ros.segment import label_clip
from diffphys_ros.steady import overlay
from diffphys_ros.tracks import on_tripod
from diffphys_ros.types import Clip
from tests.tracks.filmed import CAMERA, FRAMES, HEIGHT, MARGIN, STILL, WIDTH, filmed, pan, plain, shake, tracked, wall

SIZE, CENTRE = (WIDTH, HEIGHT), np.array([WIDTH - 1, HEIGHT - 1]) / 2


def shown(matrix: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """The wall as a frame sees it in which pixel x of frame 0 lies at matrix @ (x, 1)."""
    whole = np.vstack([matrix, [0, 0, 1]])
    from_frame = np.array([[1.0, 0, MARGIN], [0, 1, MARGIN], [0, 0, 1]]) @ np.linalg.inv(whole)
    return np.asarray(cv2.warpAffine(ground, from_frame[:2], SIZE, flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP))


def hand(*, px: float, roll: float, zoom: float, frames: int = 8) -> np.ndarray:
    rng, found = np.random.default_rng(4), [np.eye(3)[:2]]
    for _ in range(1, frames):
        angle, factor = roll * rng.normal(), 1 + zoom * rng.normal()
        turn = factor * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        found.append(np.c_[turn, px * rng.normal(size=2) + CENTRE - turn @ CENTRE])
    return np.array(found)


def test_shift_roll_and_zoom_are_found_to_a_hundredth_of_a_pixel_and_no_less_surely_than_is_said():
    rng, truth, at = np.random.default_rng(0), hand(px=2.0, roll=3e-3, zoom=1e-3), np.array([200.0, 60.0])
    grey = [np.clip(np.rint(shown(m, wall()) + rng.normal(0, 2, (HEIGHT, WIDTH))), 0, 255).astype(np.float32) for m in truth]
    found = overlay(grey, [np.ones((HEIGHT, WIDTH), bool)] * len(grey))
    off = found.shift_px(at) - (truth @ np.append(at, 1.0) - at)
    sd = float(np.median(found.sd_px(at)[1:]))
    assert np.abs(off).max() < 0.03
    assert 0.1 < np.sqrt((off[1:] ** 2).mean()) / sd < 2
    assert found.agreed.min() > 0.9


def moved(shift: np.ndarray, ground: np.ndarray | None = None, **scene: object):
    clip, tracks = filmed(wall() if ground is None else ground, shift, noise=1.0, **scene)
    return clip, tracks, on_tripod(clip, tracks, lambda _: tracked(STILL))


def test_a_hand_is_taken_off_with_labels_and_depth_and_the_note_says_how_far():
    clip, tracks = filmed(wall(), shake(1.5), noise=1.0)
    clip = replace(clip, depth=np.where(clip.labels > 0, 1.0, 2.0).astype(np.float32))
    steady = replace(tracked(STILL), points=tracked(STILL).points + np.array([0, 0, 0.3]))  # where a pixel is 1 mm wide
    held = on_tripod(clip, tracks, lambda _: steady)
    assert held.moved is None
    assert (np.abs(held.clip.labels.astype(int) - held.clip.labels[0])[:, 20:-20, 20:-20] == 1).mean() < 2e-3
    assert held.clip.depth is not None
    assert np.abs(held.clip.depth - held.clip.depth[0])[:, 20:-20, 20:-20].mean() < 2e-3
    assert (held.clip.labels[:, 0] == 255).any(), "what the camera did not see is ignored"
    far = np.linalg.norm(shake(1.5), axis=1).max()
    assert any(f"the camera moves by up to {far:.2g} px" in note for note in held.clip.notes)
    assert held.tracks.noise_m > steady.noise_m


def test_a_still_camera_leaves_the_clip_alone():
    clip, tracks, held = moved(STILL)
    assert held.clip is clip
    assert held.tracks is tracks


@pytest.mark.parametrize(
    ("shift", "sentence"),
    [(pan(2.4), r"shifts the picture by up to 31(\.\d)? px, at most 16 px"), (pan(0.3), None)],
    ids=["too far", "near"],
)
def test_a_camera_that_moves_too_far_is_refused_with_the_distance(shift: np.ndarray, sentence: str | None):
    clip, _, held = moved(shift)
    if sentence is None:
        assert held.moved is None
        return
    assert held.moved is not None
    assert "the camera moves" in held.moved.sentence()
    assert held.clip.frames is clip.frames
    assert re.search(sentence, held.clip.notes[-1])


def test_a_background_of_which_a_third_swings_is_laid_over_by_the_rest():
    _, _, held = moved(shake(1.5), branch=True)
    assert held.moved is None
    assert np.abs(held.clip.frames[:, 30:-30, 120:-30].astype(float) - held.clip.frames[0, 30:-30, 120:-30]).mean() < 4


def test_an_empty_wall_takes_nothing_off():
    clip, _, held = moved(pan(0.3), plain())
    assert held.clip.frames is clip.frames


@pytest.mark.slow
def test_what_moves_is_found_though_a_hand_moves_everything():
    """A patterned square swings by 8 px before a patterned wall; the hand by 6 px."""
    rng, true = np.random.default_rng(5), np.zeros((HEIGHT, WIDTH), bool)
    true[90:150, 130:190] = True
    square, frames = np.roll(wall(), 37, (0, 1)), []
    for k, matrix in enumerate(hand(px=6.0, roll=1e-3, zoom=0.0, frames=FRAMES)):
        scene, dx = wall().copy(), round(8 * np.sin(0.5 * k))
        scene[MARGIN + 90 : MARGIN + 150, MARGIN + 130 + dx : MARGIN + 190 + dx] = square[:60, :60]
        grey = shown(matrix, scene) + rng.normal(0, 1, (HEIGHT, WIDTH))
        frames.append(np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, 2))
    found = label_clip(Clip(np.array(frames), 0, 1 / 30, CAMERA), build({"segment.max_parts": 1}))[0] == 1
    assert (found & true).sum() / (found | true).sum() > 0.7
