"""How far tracks may be trusted, told by the tracks themselves."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

NEAREST = 9  # points left out, the track itself among them: their matching windows overlap and share its errors
RING = 20  # further points from which a displacement is predicted
UNRESOLVED = 0.05  # relative singular value below which a direction of the ring (a flat face's normal) is not fitted
SHARED = 0.25  # of the usual error that a track shares with its ring, which does not see it


def track_residuals(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Standard deviation of one coordinate of the displacement of each track [m], shape (M,), from `ring_residuals`."""
    residual, usable = ring_residuals(points, valid)
    return np.sqrt((residual**2).mean(-1).sum(0, where=usable) / np.maximum(usable.sum(0), 1))


def ring_residuals(points: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What neighbours do not predict of displacements [m], (T, M, 3), as large as the track's own error; and where they predict, (T, M).

    The displacement of a solid is smooth: it is predicted by an affine field through a ring of tracks around each one, and what is
    left, with the prediction's own share taken off, is the track's error. Errors common to the whole ring are not seen.
    Points (T, M, 3) [m], valid (T, M).
    """
    count = points.shape[1]
    if count < NEAREST + 4:
        return np.zeros(points.shape), np.zeros(valid.shape, bool)
    start = points[0]
    _, index = cKDTree(start).query(start, k=min(NEAREST + RING, count))
    ring = index[:, NEAREST:]
    offset = (start[ring] - start[:, None]) / np.maximum(np.ptp(start, axis=0).max(), 1e-12)
    basis = np.concatenate([np.ones((*ring.shape, 1)), offset / np.abs(offset).max((1, 2), keepdims=True)], -1)
    weight = np.linalg.pinv(basis, rcond=UNRESOLVED)[:, 0]
    share = np.sqrt(1 + (weight**2).sum(1))
    residual = np.stack([moved - np.einsum("mk,mkc->mc", weight, moved[ring]) for moved in points - start]) / share[:, None]
    return residual, valid & valid[:, ring].all(2)


def displacement_noise(points: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of one coordinate of a displacement [m], over all tracks (T, M, 3)."""
    return float(np.sqrt((track_residuals(points, valid) ** 2).mean()))


def position_sd(points: np.ndarray, valid: np.ndarray, by_patch: np.ndarray, eye: np.ndarray, *, along: bool) -> np.ndarray:
    """Standard deviations (T, M, 2) [m] of displacements: of a coordinate across the line of sight, and along it (see types.Tracks).

    Across, a track's patch says how well it is placed in which frame; along, depth is about as noisy in every frame, and the track's own
    residuals against its ring say how much. What the patches say is scaled to the residuals of the clip.

    Args:
        points, valid: (T, M, 3) [m], (T, M).
        by_patch: by the patches' match, up to a common factor [m], (T, M).
        eye: where the camera is [m], (3,).
        along: whether motion along the line of sight is seen.
    """
    residual, usable = ring_residuals(points, valid)
    usable[0] = False
    sight = points[0] - eye
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    depth = (residual * sight).sum(-1)
    across = np.sqrt(np.maximum((residual**2).sum(-1) - depth**2, 0) / 2)
    factor = _rms(across, usable) / max(_rms(by_patch, usable), 1e-12) if usable.any() else 1.0
    own = np.sqrt((depth**2).sum(0, where=usable) / np.maximum(usable.sum(0), 1))
    own = np.where(usable.any(0), own, _rms(depth, usable)) if along else np.full(own.shape, np.inf)
    sd = np.stack([factor * by_patch, np.broadcast_to(own, valid.shape)], -1)
    sd = np.hypot(sd, SHARED * np.array([_rms(across, usable), _rms(depth, usable)]))
    sd[~valid], sd[0] = np.inf, 0.0
    return sd


def _rms(values: np.ndarray, where: np.ndarray) -> float:
    return float(np.sqrt((values[where] ** 2).mean())) if where.any() else 0.0
