"""The border of an object's mask, point after point, and pieces of such a closed row."""

from __future__ import annotations

import cv2
import numpy as np


def border(mask: np.ndarray) -> np.ndarray:
    """The outer border (n, 2) [px] of the largest piece of a mask (H, W) that is not empty: neighbouring pixels, counterclockwise as the picture shows them."""
    return np.asarray(max(cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0], key=len)[:, 0])


def runs(flags: np.ndarray) -> list[np.ndarray]:
    """Numbers of the points of each piece of a closed row of flags (n,) that is set, in order along it; the whole row from its first point where all are."""
    if flags.all():
        return [np.arange(len(flags))]
    order = np.roll(np.arange(len(flags)), -int(np.flatnonzero(~flags)[0]))
    steps = np.flatnonzero(np.diff(np.concatenate([[0], flags[order].astype(int), [0]]))).reshape(-1, 2)
    return [order[a:b] for a, b in steps]
