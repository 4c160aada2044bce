"""What label images say."""

from __future__ import annotations

import numpy as np

IGNORE = 255  # label of pixels that are neither object nor background (an arm, an occluder)


def object_mask(labels: np.ndarray) -> np.ndarray:
    """Where label images (..., H, W) show the object, bool: neither background nor IGNORE."""
    mask = labels > 0
    mask &= labels != IGNORE  # in place: they may be those of a whole clip
    return mask
