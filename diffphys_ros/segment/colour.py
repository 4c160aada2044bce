"""Object or background, where two masks disagree: what the colours around say."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from .regions import disc, window_of

UNSURE_PX = 5  # around a disagreement that is more than a border's width of noise
AROUND_PX = 20  # colours are learnt this far around
NEAREST = 5  # sure pixels of either side that a first guess looks at
ROUNDS = 3  # of GrabCut


def settle_by_colour(frame: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The object's mask (H, W): `a` where masks a and b agree, by GrabCut (Rother et al. 2004) around where they do not.

    Colours (RGB frame, (H, W, 3)) are learnt from the pixels near by on which both agree. A thick disagreement casts doubt on the
    pixels beside it too: both masks may have missed the rest of a face that turns into view.
    """
    doubted = _doubted(a, b)
    near = cv2.dilate(doubted.astype(np.uint8), disc(AROUND_PX)) > 0
    sure_object, sure_rest = near & ~doubted & a, near & ~doubted & ~a
    if min(sure_object.sum(), sure_rest.sum()) < NEAREST or not doubted.any():
        return a
    likely = _nearer(frame, doubted, sure_object, sure_rest)
    state = np.where(a, cv2.GC_FGD, cv2.GC_BGD).astype(np.uint8)
    state[doubted] = np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD)
    window = window_of(near)
    cut = state[window].copy()
    cv2.setRNGSeed(0)  # its k-means draws from a global generator
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(frame[window]), cut, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    mask = a.copy()
    mask[window] = (cut == cv2.GC_FGD) | (cut == cv2.GC_PR_FGD)
    return mask


def _doubted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    differ = (a != b).astype(np.uint8)
    thick = cv2.morphologyEx(differ, cv2.MORPH_OPEN, np.ones((3, 3)))
    return (differ > 0) | (cv2.dilate(thick, disc(UNSURE_PX)) > 0)


def _nearer(frame: np.ndarray, pixels: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Whether the colour of each of `pixels` lies nearer to those of `one` than of `other`, CIELAB, (N,)."""
    lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB).astype(np.float32)
    distance = [cKDTree(lab[side]).query(lab[pixels], k=NEAREST)[0].mean(1) for side in (one, other)]
    return distance[0] < distance[1]
