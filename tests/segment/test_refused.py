"""Clips and masks that hold no object to work on: a result or one sentence, whatever OpenCV makes of them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.bags.camera import camera_from_fov
from diffphys_ros.errors import InputError
from diffphys_ros.segment import label_clip
from diffphys_ros.segment.given import MOST_PARTS, given_mask
from diffphys_ros.segment.motion import _by_colour, motion_mask
from diffphys_ros.segment.parts import split_parts
from diffphys_ros.types import Clip

HEIGHT, WIDTH = 48, 64


def clip_of(frames: np.ndarray) -> Clip:
    return Clip(frames, 0, 1 / 30, camera_from_fov(60.0, frames.shape[2], frames.shape[1]), source="test")


def noise(frames: int = 6, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (frames, height, width, 3)).astype(np.uint8)


@pytest.mark.parametrize(("height", "width"), [(24, 300), (300, 24), (1, 1), (8, 8), (31, 2000)])
@pytest.mark.parametrize("method", ["motion", "given"])
def test_frames_too_narrow_for_optical_flow_are_refused(height: int, width: int, method: str) -> None:
    clip = replace(clip_of(noise(4, height, width)), first_labels=np.ones((height, width), np.uint8))
    with pytest.raises(InputError, match=rf"frames have {width} x {height} pixels, needs at least 32 a side"):
        label_clip(clip, config.build({"segment.method": method}))


@pytest.mark.parametrize("height", [32, 33])
@pytest.mark.parametrize("width", [32, 65, 2000])
def test_the_narrowest_frames_that_are_taken_are_seen_through(height: int, width: int) -> None:
    clip = replace(clip_of(noise(3, height, width)), first_labels=np.full((height, width), 255, np.uint8))
    assert label_clip(clip, config.Settings()).shape == (3, height, width)


@pytest.mark.parametrize("frames", [np.zeros((6, HEIGHT, WIDTH, 3), np.uint8), np.repeat(noise(1), 6, 0)], ids=["black", "still"])
def test_a_clip_in_which_nothing_is_seen_to_move_is_refused(frames: np.ndarray) -> None:
    with pytest.raises(InputError, match="seen to move"):
        label_clip(clip_of(frames), config.Settings())


def test_where_all_of_the_picture_is_likely_object_colours_tell_nothing_apart() -> None:
    full = np.ones((HEIGHT, WIDTH), bool)
    found = _by_colour(noise(1)[0], full, full, full)
    assert found.all()
    assert not _by_colour(noise(1)[0], ~full, ~full, full).any()


@pytest.mark.parametrize("seed", range(4))
def test_noise_ends_as_labels_or_as_a_sentence(seed: int) -> None:
    frames = np.random.default_rng(seed).integers(0, 256, (5, HEIGHT, WIDTH, 3)).astype(np.uint8)
    with suppress(InputError):
        assert motion_mask(clip_of(frames), config.Settings()).shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize("pixels", [1, 2, 7])
def test_a_mask_of_fewer_pixels_than_parts_is_taken(pixels: int) -> None:
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[20, 20 : 20 + pixels] = True
    parts = split_parts(noise(1)[0], mask, max_parts=8)
    assert 1 <= parts[mask].min() <= parts[mask].max() <= pixels
    assert label_clip(replace(clip_of(noise()), first_labels=np.where(mask, 255, 0).astype(np.uint8)), config.Settings()).shape == (6, HEIGHT, WIDTH)


@pytest.mark.parametrize("value", [1, 255])
def test_a_mask_of_the_full_frame_is_taken(value: int) -> None:
    clip = replace(clip_of(noise()), first_labels=np.full((HEIGHT, WIDTH), value, np.uint8))
    assert (label_clip(clip, config.build({"segment.max_parts": 1}))[0] == 1).all()


def test_a_mask_of_more_parts_than_motion_tells_apart_is_refused() -> None:
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[0, : MOST_PARTS + 1] = np.arange(1, MOST_PARTS + 2)
    with pytest.raises(InputError, match=r"has 17 parts, at most 16"):
        given_mask(replace(clip_of(noise()), first_labels=labels), config.Settings())


@pytest.mark.parametrize("name", ["x" * 5000, "nothing.png", "a\0b.png", "/dev/zero", "."])
def test_a_mask_file_that_cannot_be_is_refused_in_one_short_line(name: str) -> None:
    with pytest.raises(InputError, match="not a readable image") as caught:
        given_mask(clip_of(noise()), replace(config.Settings(), scene=config.Scene(first_mask=name)))
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("content", [b"", b"P5\n30000 40000\n255\n", b"\x89PNG\r\n\x1a\n" + bytes(40), "float"])
def test_a_mask_file_that_is_no_image_of_whole_numbers_is_refused(tmp_path: Path, content: bytes | str) -> None:
    path = tmp_path / "mask.tiff"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), np.nan, np.float32))
    with pytest.raises(InputError, match="not a readable image of whole numbers"):
        given_mask(clip_of(noise()), config.build({"scene.first_mask": str(path)}))
