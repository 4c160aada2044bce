"""What was not seen, from what was: the nearest known pixel's value, the scene behind what moves."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt


def nearest_known(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (H, W, ...) with each unknown pixel's taken from the nearest known one; known: bool (H, W), true somewhere."""
    index = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return values[tuple(index)]


def scene_behind(frames: np.ndarray, shown: np.ndarray, *, least_share: float = 0.0) -> np.ndarray:
    """Median of frames (T, H, W, 3) where they show the scene, `shown` (T, H, W), uint8 (H, W, 3).

    Pixels shown in no more than `least_share` of the frames take the nearest other's; black where there is none.
    """
    known = shown.mean(0) > least_share
    scene = np.zeros(frames.shape[1:], np.uint8)
    if not known.any():
        return scene
    seen = np.where(shown[:, known, None], frames[:, known].astype(np.float32), np.nan)
    scene[known] = np.nanmedian(seen, 0).astype(np.uint8)
    return nearest_known(scene, known)
