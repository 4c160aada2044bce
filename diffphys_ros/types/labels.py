"""What label images say."""

from __future__ import annotations

import numpy as np

IGNORE = 255  # label of pixels that are neither object nor background (an arm, an occluder)


def object_mask(labels: np.ndarray) -> np.ndarray:
    """Where label images (..., H, W) show the object, bool: neither background nor IGNORE."""
    return (labels > 0) & (labels != IGNORE)
