"""How far tracks may be trusted, told by the tracks themselves."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

NEAREST = 9  # points left out, the track itself among them: their matching windows overlap and share its errors
RING = 20  # further points from which a displacement is predicted
UNRESOLVED = 0.05  # relative singular value below which a direction of the ring (a flat face's normal) is not fitted


def track_residuals(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Standard deviation of one coordinate of the displacement of each track [m], shape (M,).

    The displacement of a solid is smooth: it is predicted by an affine field through a ring of tracks around each one, and what is
    left, with the prediction's own share taken off, is the track's error. Errors common to the whole ring are not seen.
    Points (T, M, 3) [m], valid (T, M).
    """
    count = points.shape[1]
    if count < NEAREST + 4:
        return np.zeros(count)
    start = points[0]
    _, index = cKDTree(start).query(start, k=min(NEAREST + RING, count))
    ring = index[:, NEAREST:]
    offset = (start[ring] - start[:, None]) / np.maximum(np.ptp(start, axis=0).max(), 1e-12)
    basis = np.concatenate([np.ones((*ring.shape, 1)), offset / np.abs(offset).max((1, 2), keepdims=True)], -1)
    weight = np.linalg.pinv(basis, rcond=UNRESOLVED)[:, 0]
    share = 1 + (weight**2).sum(1)
    total, frames = np.zeros(count), np.zeros(count)
    for frame, good in zip(points, valid, strict=True):
        moved = frame - start
        error = ((moved - np.einsum("mk,mkc->mc", weight, moved[ring])) ** 2).mean(-1) / share
        usable = good & good[ring].all(1)
        total += np.where(usable, error, 0)
        frames += usable
    return np.sqrt(total / np.maximum(frames, 1))


def displacement_noise(points: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of one coordinate of a displacement [m], over all tracks (T, M, 3)."""
    return float(np.sqrt((track_residuals(points, valid) ** 2).mean()))
