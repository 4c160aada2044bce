"""Parts by colour: pieces, not spots or seams."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from diffphys_ros.segment.parts import split_parts

MASK = np.zeros((140, 260), bool)
MASK[40:100, 30:230] = True
COLOURS = {"violet": (120, 40, 160), "green": (90, 160, 40), "ochre": (170, 140, 20)}


def painted(*bands: tuple[int, str]) -> np.ndarray:
    """RGB frame of the strip in bands of colour that begin at these columns, under a sensor's noise."""
    frame = np.full((*MASK.shape, 3), 130.0)
    for first, colour in bands:
        frame[40:100, first:230] = COLOURS[colour]
    return frame


def taken(frame: np.ndarray, *, blur_px: float = 0.7) -> np.ndarray:
    noise = np.random.default_rng(0).normal(0, 4, frame.shape)
    return np.clip(cv2.GaussianBlur(frame, (0, 0), blur_px) + noise, 0, 255).astype(np.uint8)


def test_bands_of_colour_are_parts_with_their_borders() -> None:
    parts = split_parts(taken(painted((30, "violet"), (110, "green"), (170, "ochre"))), MASK, max_parts=4)
    assert set(np.unique(parts[MASK])) == {1, 2, 3}
    for first, last in ((30, 110), (110, 170), (170, 230)):
        assert len(np.unique(parts[40:100, first + 2 : last - 2])) == 1


def test_the_mixed_colours_of_a_seam_are_no_part() -> None:
    frame = painted((30, "violet"), (130, "green"))
    frame[40:100, 122:138] = 0.5 * np.array(COLOURS["violet"]) + 0.5 * np.array(COLOURS["green"])
    parts = split_parts(taken(frame), MASK, max_parts=3)
    assert set(np.unique(parts[MASK])) == {1, 2}


@pytest.mark.parametrize("rows", [slice(60, 84), slice(40, 64)], ids=["enclosed", "at the edge"])
def test_a_spot_is_no_part(rows: slice) -> None:
    frame = painted((30, "violet"), (110, "green"))
    frame[rows, 160:184] = COLOURS["ochre"]
    parts = split_parts(taken(frame), MASK, max_parts=3)
    assert set(np.unique(parts[MASK])) == {1, 2}
    assert len(np.unique(parts[40:100, 112:230])) == 1


def compressed(frame: np.ndarray, quality: int) -> np.ndarray:
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR))


@pytest.mark.parametrize("shade", [0.3, 0.4, 0.5, 0.7])
@pytest.mark.parametrize("bands", [((30, "violet"), (130, "green")), ((30, "violet"), (95, "green"), (165, "ochre"))])
def test_a_side_in_the_shade_is_no_part_of_its_own(bands: tuple[tuple[int, str], ...], shade: float) -> None:
    """Noise and compression change dark colours more."""
    for quality in (60, 80):
        frame = painted(*bands)
        frame[85:100, 30:230] *= shade
        parts = split_parts(compressed(taken(frame, blur_px=0.8), quality), MASK, max_parts=4)
        assert set(np.unique(parts[MASK])) == set(range(1, len(bands) + 1))
        ends = [first for first, _ in bands[1:]]
        assert all(len(np.unique(parts[40:100, first + 4 : last - 4])) == 1 for first, last in zip((30, *ends), (*ends, 230), strict=True))


def test_a_large_inlay_is_a_part() -> None:
    frame = painted((30, "violet"))
    frame[50:90, 80:150] = COLOURS["green"]
    assert set(np.unique(split_parts(taken(frame), MASK, max_parts=3)[MASK])) == {1, 2}


def test_two_large_pieces_of_one_colour_are_one_part() -> None:
    """Such as the prongs of a fork."""
    parts = split_parts(taken(painted((30, "violet"), (95, "green"), (165, "violet"))), MASK, max_parts=4)
    ends, middle = np.r_[parts[40:100, 32:93].ravel(), parts[40:100, 167:228].ravel()], parts[40:100, 97:163]
    assert len(np.unique(ends)) == len(np.unique(middle)) == 1
    assert ends[0] != middle[0, 0]
