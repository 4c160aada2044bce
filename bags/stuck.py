"""A camera or a driver that hands out one picture again and again while the object moves on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

LEAST_CHANGE = 0.3  # of the usual change from frame to frame, before and after pictures that are equal to the bit: without it the object rests


def stuck_frames(frames: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """Which of the frames (T, H, W, 3) uint8, among those `observed` (T,), show the picture before once more though things move before and
    after; bool (T,). Equal is equal in every pixel: where an object turns about, two frames are alike but hardly the same."""
    received = np.flatnonzero(observed)
    change = np.array([0.0, *(_change(frames[a], frames[b]) for a, b in pairwise(received))])
    least = LEAST_CHANGE * float(np.median(change[change > 0])) if change.any() else 0.0
    stuck = np.zeros(len(frames), bool)
    for first, last in _runs(change == 0.0):
        before, after = (change[first - 1] if first else 0.0), (change[last + 1] if last + 1 < len(change) else np.inf)
        if least > 0 and before >= least and after >= least:
            stuck[received[first : last + 1]] = True
    return stuck


def _change(a: np.ndarray, b: np.ndarray) -> float:
    """Mean difference of two pictures [levels]; 0 only where every pixel is equal."""
    return 0.0 if np.array_equal(a, b) else max(float(np.abs(a.astype(np.int16) - b).mean()), 1e-12)


def _runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2)]
