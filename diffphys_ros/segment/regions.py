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


def filled(mask: np.ndarray) -> np.ndarray:
    """A mask without holes, bool (H, W)."""
    return binary_fill_holes(mask)


def window_of(mask: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of the smallest window around a mask that is not empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
