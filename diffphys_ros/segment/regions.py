"""Connected regions of a mask."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import binary_fill_holes


def touching(mask: np.ndarray, seed: np.ndarray) -> np.ndarray:
    """The connected region of a mask that shares most pixels with `seed` (H, W), bool (H, W)."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8))
    shared = np.bincount(labels[seed & mask], minlength=labels.max() + 1)
    return labels == np.argmax(shared) if shared[1:].any() else np.zeros(mask.shape, bool)


def filled(mask: np.ndarray, *, but: np.ndarray | None = None) -> np.ndarray:
    """A mask without holes, bool (H, W), but for those in which pixels of `but` (H, W) lie."""
    whole = binary_fill_holes(mask)
    if but is None:
        return whole
    _, holes = cv2.connectedComponents((whole & ~mask).astype(np.uint8))
    return whole & ~np.isin(holes, np.setdiff1d(holes[but & ~mask], 0))


def disc(radius: int) -> np.ndarray:
    """Structuring element of all pixels within a radius [px]."""
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def pixel_grid(shape: tuple[int, ...]) -> np.ndarray:
    """Every pixel's own position u, v of an image (H, W), float32 (H, W, 2)."""
    return np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), -1).astype(np.float32)


def window_of(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the smallest window around a mask that is not empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
