"""What all tracks share: a few coordinates over time, which tell wrong positions and correct the depth of frame 0."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Clip

RANK = 6  # most coordinates: the modes that move, and their products
STEADY = 0.9  # share of the received frames in which a track must hold to span the coordinates
LEAST_STEADY = 40  # tracks that must; else the best ones do
LEAST_HOLDING = 0.1  # share of the tracks that must hold in a frame
FRAMES_PER_RANK = 4  # received frames that one coordinate needs
WILD, FAR = 10.0, 4.0  # of a position from the fit, in medians over all tracks and frames: it no longer counts, first and last
ROUNDS = 4  # of fitting again at the end
REFITS, SMALLEST_SHARE = 6, 0.1  # rounds of reweighting; errors below this share of their median weigh alike
WRONG = 7.0  # from which the track does not hold in that frame
LEAST_SIZE = 1e-30  # m^2: of the shapes' second moment where no track holds in a frame, or none moves
RIDGE = 1e-3  # against tracks that hold in few frames; a coordinate seen in all of them has the weight of their number


@dataclass(frozen=True)
class SharedMotion:
    """position(t, m) = mean_m + sum_i q_i(t) shape_mi + error, for all frames alike, frame 0 among them."""

    fitted: np.ndarray  # positions [m], (T, M, 3)
    error: np.ndarray  # its length [m], (T, M)
    scale: float  # median of that [m]
    known: np.ndarray  # frames in which enough tracks hold, bool, (T,)

    @property
    def plausible(self) -> np.ndarray:
        """Which positions lie near the fit, bool, (T, M)."""
        return self.known[:, None] & (self.error < WRONG * self.scale)


def settled(clip: Clip, points: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, M, 3) [m] and validity (T, M) without what no motion shared by all tracks explains.

    A depth topic's error in frame 0 would stay in every displacement: there the depth of frame 0 is moved to where all frames
    together put it. Few tracks or frames are given back as they are.
    """
    shared = shared_motion(points, valid, clip.seen)
    if shared is None:
        return points, valid
    valid, points = valid & shared.plausible, points.copy()
    valid[0] = True
    if clip.depth is not None:
        sight = points[0] - clip.camera.position
        share = ((shared.fitted[0] - points[0]) * sight).sum(1) / (sight**2).sum(1)
        points[0] += share[:, None] * sight
    return points, valid


def shared_motion(points: np.ndarray, valid: np.ndarray, seen: np.ndarray) -> SharedMotion | None:
    """The motion that tracks (T, M, 3) [m] with validity (T, M) share over the received frames (T,); None where too few hold.

    One coordinate after the other: what is far off from few of them never gets a coordinate of its own.
    """
    if valid.shape[1] < LEAST_STEADY:
        return None
    known = seen & (valid.mean(1) > LEAST_HOLDING)
    if known.sum() < FRAMES_PER_RANK:
        return None
    moved, holds = points[known] - points[:1], valid[known]
    share = holds.mean(0)
    steady = share >= min(STEADY, np.sort(share)[-LEAST_STEADY])
    fitted, counted = np.repeat(_medians(moved, holds)[:, None], moved.shape[1], 1), holds
    most = min(RANK, len(moved) // FRAMES_PER_RANK)
    for rank, far in [(r, WILD) for r in range(1, most + 1)] + [(most, FAR)] * ROUNDS:
        q = _coordinates(np.where(counted[..., None], moved, fitted)[:, steady], rank)
        shapes = _shapes(q, moved, counted)
        fitted = _refitted(shapes, moved, holds)
        error = np.linalg.norm(moved - fitted, axis=2)
        scale = max(float(np.median(error[holds])), 1e-12)
        counted = holds & (error < far * scale)
    everywhere, errors = points.copy(), np.zeros(valid.shape)
    everywhere[known], errors[known] = points[:1] + fitted, error
    return SharedMotion(everywhere, errors, scale, known)


def _medians(moved: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Median displacement (F, 3) of the tracks that hold in each frame."""
    return np.stack([np.median(m[v], axis=0) for m, v in zip(moved, valid, strict=True)])


def _coordinates(moved: np.ndarray, rank: int) -> np.ndarray:
    """Leading coordinates (F, rank), root mean square 1, of displacements (F, M, 3) about each track's mean; fewer where the others are
    lost in noise (Gavish and Donoho 2014, "The optimal hard threshold for singular values is 4 / sqrt(3)", equation 5)."""
    flat = moved.reshape(len(moved), -1)
    u, s, _ = np.linalg.svd(flat - flat.mean(0), full_matrices=False)
    ratio = min(flat.shape) / max(flat.shape)
    threshold = (0.56 * ratio**3 - 0.95 * ratio**2 + 1.82 * ratio + 1.43) * np.median(s)
    return u[:, : max(1, min(rank, int((s > threshold).sum())))] * np.sqrt(len(moved))


def _shapes(q: np.ndarray, moved: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Least-squares shapes (M, r + 1, 3), a constant last, of displacements (F, M, 3) over coordinates (F, r), each track over its own
    frames."""
    terms = np.column_stack([q, np.ones(len(q))])
    own = counted.T[:, None] * terms.T  # (M, r + 1, F)
    normal = own @ terms + RIDGE * np.eye(terms.shape[1])
    moment = own @ moved.swapaxes(0, 1)
    return np.linalg.solve(normal, moment)


def _refitted(shapes: np.ndarray, moved: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Fit (F, M, 3) with every frame's coordinates found again from all tracks that hold in it, by least absolute deviations: a frame
    whose coordinates were off, and whose tracks therefore no longer counted, comes back."""
    design, constant = shapes[:, :-1].transpose(0, 2, 1), shapes[:, -1]
    offset, weight = moved - constant, holds.astype(float)
    flat, squared = design.reshape(-1, design.shape[2]), np.swapaxes(design, 1, 2) @ design
    for _ in range(REFITS):
        normal = np.tensordot(weight, squared, 1)
        moment = (weight[..., None] * offset).reshape(len(weight), -1) @ flat
        size = np.maximum(np.trace(normal, axis1=1, axis2=2), LEAST_SIZE)[:, None, None]
        ridge = RIDGE * size * np.eye(design.shape[2]) / design.shape[2]
        q = np.linalg.solve(normal + ridge * RIDGE, moment[..., None])[..., 0]
        fitted = constant + (q @ flat.T).reshape(offset.shape)
        error = np.linalg.norm(moved - fitted, axis=2)
        weight = holds / np.maximum(error, SMALLEST_SHARE * np.median(error[holds]) + 1e-12)
    return fitted
