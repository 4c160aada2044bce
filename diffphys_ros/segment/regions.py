"""Connected regions of a mask."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import binary_fill_holes


def largest(mask: np.ndarray) -> np.ndarray:
    """The largest connected region of a mask, bool (H, W)."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    return labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA]) if count > 1 else np.zeros(mask.shape, bool)


def filled(mask: np.ndarray) -> np.ndarray:
    """A mask without holes, bool (H, W)."""
    return binary_fill_holes(mask)
