"""Pixels where something passes between camera and object: depth and colours that contradict the object's own."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ..inpaint import scene_behind
from .interpolate import affine_values
from .regions import window_of

NEARER = 0.02  # share of the depth by which something must lie before the object to hide it
NOISE = 6.0  # and robust standard deviations of the depth at the object's tracks
NEIGHBOURS = 8  # tracks whose median tells how far a piece of the object came nearer
STEP_PX = 4  # distance of the pixels at which that is evaluated
LEAST_PX = 5  # side of the smallest thing that can hide an object
MARGIN_PX = 2  # pixels around it mix its colour with the object's
LIGHTNESS = 0.5  # weight of lightness in colour distances: shading varies it
STRANGE = (
    14.0  # CIELAB units, on average over a small window, from which colours are not the same: a match is within 11 for 99 of 100 pixels
)
MOST_STRANGE = 36.0  # that one pixel counts
WINDOW_PX = 9  # side of that window
SHOWN_SHARE = 0.34  # of those frames in which a pixel of the scene must be seen: an arm over the object may pass for background for a while
BACKGROUND_FRAMES = 15  # that are asked what the scene behind the object looks like
AROUND_PX = 6  # of where a pixel came from in which its depth is looked up: that place is not known better


class DepthWitness:
    """Compares every depth image with the object's own surface: frame 0's, moved along with the tracks.

    depth (T, H, W) [m] with 0 where unknown, first object mask (H, W), tracks' pixels `start` (M, 2) in frame 0.
    """

    def __init__(self, depth: np.ndarray, first: np.ndarray, start: np.ndarray):
        self.depth, self.start = depth, start
        known = np.where(first & (depth[0] > 0), depth[0], np.inf).astype(np.float32)
        nearest = cv2.erode(known, np.ones((2 * AROUND_PX + 1,) * 2, np.uint8))
        self.first = np.where(first & np.isfinite(nearest), nearest, 0).astype(np.float32)  # 0: unknown

    def hidden(self, k: int, pixels: np.ndarray, valid: np.ndarray, source: np.ndarray, region: np.ndarray) -> np.ndarray:
        """Pixels of `region` (H, W) in frame k before which something else stands, bool (H, W).

        Tracks at `pixels` (M, 2), valid (M,); `source` (H, W, 2): where pixels came from in frame 0.
        """
        now, before = (_read(self.depth[i], at) for i, at in ((k, pixels), (0, self.start)))
        good = valid & (now > 0) & (before > 0)
        if not region.any():
            return region
        window = window_of(region)
        expected = cv2.remap(self.first, source[window], None, cv2.INTER_NEAREST)
        if good.sum() >= NEIGHBOURS:
            nearest, noise = _approach(pixels[good], (now - before)[good], window)
            bound = NEARER * expected + NOISE * noise
        else:  # hidden as a whole: it may have come nearer by as much again
            nearest, bound = np.zeros(expected.shape, np.float32), 2 * NEARER * expected
        measured, found = self.depth[k][window], np.zeros(region.shape, bool)
        found[window] = solid((expected > 0) & (measured > 0) & (measured < expected + nearest - bound) & region[window])
        return found


class ColourWitness:
    """Compares every frame with the first one (RGB, (H, W, 3)) at the places that its pixels came from."""

    def __init__(self, first_frame: np.ndarray):
        self.first = _weighted_lab(first_frame)

    def strange(self, frame: np.ndarray, sources: Iterable[np.ndarray], region: np.ndarray) -> np.ndarray:
        """Pixels of `region` (H, W) whose surroundings look like none of `sources`, each (H, W, 2) [px in frame 0], bool (H, W)."""
        found = np.zeros(region.shape, bool)
        if region.any():
            window = window_of(region)
            lab = _weighted_lab(np.ascontiguousarray(frame[window]))
            found[window] = solid(
                region[window] & (np.min([self._unlike(lab, source[window], region[window]) for source in sources], 0) > STRANGE)
            )
        return found

    def _unlike(self, lab: np.ndarray, source: np.ndarray, region: np.ndarray) -> np.ndarray:
        came_from = cv2.remap(self.first, source, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return _mean_over(_difference(lab, came_from), region)


def solid(mask: np.ndarray) -> np.ndarray:
    """What of a mask is no speck or line, with a margin, bool (H, W)."""
    opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((LEAST_PX, LEAST_PX), np.uint8))
    return cv2.dilate(opened, np.ones((2 * MARGIN_PX + 1,) * 2, np.uint8)) > 0


def before_the_scene(frames: np.ndarray, shown: np.ndarray, odd: np.ndarray) -> np.ndarray:
    """Which strange pixels `odd` (T, H, W) are not simply the scene behind, laid open: those unlike what the nearest pixel shows that is
    ever `shown` (T, H, W) as background; bool (T, H, W)."""
    if not odd.any():
        return odd
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(BACKGROUND_FRAMES, len(frames))).astype(int))
    behind = _weighted_lab(scene_behind(frames[chosen], shown[chosen], least_share=SHOWN_SHARE))
    found = np.zeros_like(odd)
    for k in np.flatnonzero(odd.any((1, 2))):
        unlike = _mean_over(_difference(_weighted_lab(frames[k]), behind), odd[k])
        found[k] = odd[k] & solid(odd[k] & (unlike > STRANGE))
    return found


def _approach(pixels: np.ndarray, values: np.ndarray, window: tuple[slice, slice]) -> tuple[np.ndarray, float]:
    """Least change of depth (h, w) [m] that the tracks (M, 2) with `values` (M,) leave possible at the pixels of a window: the smaller one of
    their neighbours' median and of a plane through them; and the robust standard deviation of the values from that median."""
    tree = cKDTree(pixels)
    median = np.median(values[tree.query(pixels, k=NEIGHBOURS)[1]], 1)
    rows, columns = (np.arange(side.start, side.stop + STEP_PX, STEP_PX) for side in window)
    coarse = np.stack(np.meshgrid(columns, rows), -1).astype(float)
    at, known = coarse.reshape(-1, 2), median[:, None]  # a single wrong depth has no say
    least = np.minimum(affine_values(at, pixels.astype(float), known)[:, 0], median[tree.query(at)[1]])
    grid = np.stack(np.meshgrid(*(np.arange(side.stop - side.start) for side in window[::-1])), -1).astype(np.float32) / STEP_PX
    fine = cv2.remap(least.reshape(coarse.shape[:2]).astype(np.float32), grid, None, cv2.INTER_LINEAR)
    return fine, 1.4826 * float(np.median(np.abs(values - median)))


def _read(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Depth [m] at the nearest pixels (M,), 0 where unknown or outside."""
    index = np.rint(pixels).astype(int)
    inside = ((index >= 0) & (index < depth.shape[::-1])).all(-1)
    index = np.where(inside[:, None], index, 0)
    return np.where(inside, depth[index[:, 1], index[:, 0]], 0).astype(float)


def _weighted_lab(image: np.ndarray) -> np.ndarray:
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    return lab * np.array([LIGHTNESS, 1, 1], np.float32)


def _mean_over(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Mean of values (H, W) over the mask's pixels in a window around each, float32 (H, W)."""
    total, count = (cv2.boxFilter(a.astype(np.float32), -1, (WINDOW_PX, WINDOW_PX), normalize=False) for a in (values * mask, mask))
    return total / np.maximum(count, 1)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """CIELAB distance of two images (H, W, 3), capped."""
    return np.minimum(np.linalg.norm(a - b, axis=-1), MOST_STRANGE)
