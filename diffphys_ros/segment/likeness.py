"""Which of two sets of pixels the colours of a picture are more like."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

BINS = 32  # a channel of CIELAB
BLUR_BINS = 1.0  # of the frequencies: pixels are few
BLUR_PX = 1.5  # of what single pixels say
FLOOR = 1e-6  # of a frequency: colours that neither has say nothing


def likeness(frame: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Logarithm of how much more frequent the colours of an RGB frame (H, W, 3) are on the pixels `one` than on `other`, bool (H, W) each;
    float32 (H, W)."""
    lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB)
    bins = (lab // (256 // BINS)).astype(int) @ (BINS * BINS, BINS, 1)
    shares = [_frequencies(bins[side])[bins] for side in (one, other)]
    return cv2.GaussianBlur(np.log((shares[0] + FLOOR) / (shares[1] + FLOOR)).astype(np.float32), (0, 0), BLUR_PX)


def _frequencies(bins: np.ndarray) -> np.ndarray:
    count = np.bincount(bins, minlength=BINS**3).reshape(BINS, BINS, BINS).astype(np.float32)
    return gaussian_filter(count, BLUR_BINS).ravel() / max(len(bins), 1)
