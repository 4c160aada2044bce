"""What was not seen, from what was: the value of the nearest pixel, and of the nearest known one, the scene behind what moves."""

from __future__ import annotations

import numpy as np

BAND_ROWS = 32  # of the frames, whose median is taken at a time: as numbers they need many times their memory


def nearest_known(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values (H, W, ...) with each unknown pixel's taken from the nearest known one; known: bool (H, W), true somewhere."""
    from scipy.ndimage import distance_transform_edt  # late: half of what a node imports before it answers, and none fills pixels itself

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
    for top in range(0, len(known), BAND_ROWS):
        band = slice(top, top + BAND_ROWS)
        there = known[band]
        if there.any():
            seen = np.where(shown[:, band][:, there, None], frames[:, band][:, there].astype(np.float32), np.nan)
            scene[band][there] = np.nanmedian(seen, 0).astype(np.uint8)
    return nearest_known(scene, known)


def nearest(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values of an image (H, W) at the pixels nearest to positions (..., 2); 0 outside."""
    index = np.rint(pixels).astype(int)
    inside = ((index >= 0) & (index < image.shape[::-1])).all(-1)
    index = np.where(inside[..., None], index, 0)
    return np.where(inside, image[index[..., 1], index[..., 0]], 0)
