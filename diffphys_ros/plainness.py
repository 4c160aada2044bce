"""Whether an object is plain: whether nothing on its surface can be followed."""

from __future__ import annotations

import cv2
import numpy as np

from .matching import Matching, normalised, seed_points, track_pixels

EDGE_PX, EDGE_SHARE = 7, 0.3  # from the object's border within which its edge passes for texture; of its half width, where it is narrow [chosen]
TRIED, STRIDE = 12, 2  # frames in which points are looked for, and from one to the next [numerical]
MOST_POINTS = 200  # that are tried [numerical]
LEAST_SHARE = 0.9  # of them in which a point must be found [chosen]
ENOUGH, ENOUGH_SHARE = 8, 0.1  # points that must be, as many as tracks need, and of those tried: sparse strokes hold .2, edges of plain faces .05 [chosen]
INNER_SHARE = 0.5  # of the half width: so far inside, grey levels are looked at [chosen]
FINE_PX, LEAST_GREY = 3.0, 3.0  # what is finer than this is texture, and its grey levels (root mean square within a matching window) about a point that counts: compression of a plain film makes 2.5 [chosen]
ROUGH_GREY = 4.0  # grey levels of it within a matching window, of half the surface, where it is textured: noise of a camera has less [chosen]


def plain(frames: np.ndarray, mask: np.ndarray, matching: Matching, *, spacing_px: int) -> bool:
    """Whether the object `mask` (H, W) of the first of frames (T, H, W, 3) is plain, shading and folds apart: too few points of its surface are
    found again, and not because it leaps, for half of its surface has hardly any fine grey to be found by. Nothing at all is not plain."""
    depth = _depth(mask)
    inside = depth > INNER_SHARE * depth.max()
    if not inside.any():
        return False
    rough = float(np.median(_grey_within(frames[0], inside, matching.window_px)[inside]))
    return rough < ROUGH_GREY and not followed(frames, mask, matching, spacing_px=spacing_px)


def followed(frames: np.ndarray, mask: np.ndarray, matching: Matching, *, spacing_px: int) -> bool:
    """Whether enough points inside the object `mask` (H, W) of the first of frames (T, H, W, 3) can be followed, by what is seen around them: a
    flat patch is found everywhere."""
    depth = _depth(mask)
    inside = depth > min(EDGE_PX, EDGE_SHARE * depth.max())
    images = [normalised(frame) for frame in frames[::STRIDE][:TRIED]]
    start = seed_points(images[0], inside, spacing_px=spacing_px, most=MOST_POINTS)
    _, valid = track_pixels(images, start, np.ones(len(images), bool), matching)
    column, row = start.astype(int).T
    shown = _grey_within(frames[0], inside, matching.window_px)[row, column] >= LEAST_GREY
    held = (valid.mean(0) >= LEAST_SHARE) & shown
    return bool(held.sum() >= max(ENOUGH, ENOUGH_SHARE * len(start)))


def _depth(mask: np.ndarray) -> np.ndarray:
    """How far inside each pixel lies [px], (H, W)."""
    return cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]


def _grey_within(frame: np.ndarray, inside: np.ndarray, window_px: int) -> np.ndarray:
    """Grey levels finer than FINE_PX, root mean square over the pixels `inside` (H, W) of the window about each, (H, W); 0 where there are none."""
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    square = np.where(inside, (grey - cv2.GaussianBlur(grey, (0, 0), FINE_PX)) ** 2, 0.0).astype(np.float32)
    total, share = (cv2.boxFilter(each, -1, (window_px, window_px)) for each in (square, inside.astype(np.float32)))
    return np.sqrt(np.maximum(total, 0.0) / np.maximum(share, 1.0 / window_px**2))
