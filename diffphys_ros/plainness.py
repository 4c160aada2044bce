"""Whether an object is plain: whether nothing on its surface can be followed."""

from __future__ import annotations

import cv2
import numpy as np

from .matching import Matching, normalised, seed_points, track_pixels

EDGE_PX, EDGE_SHARE = 7, 0.3  # from the object's border within which its edge passes for texture; of its half width, where it is narrow [chosen]
TRIED, STRIDE = 12, 2  # frames in which points are looked for, and from one to the next [numerical]
MOST_POINTS = 200  # that are tried [numerical]
LEAST_SHARE = 0.9  # of them in which a point must be found [chosen]
ENOUGH, ENOUGH_SHARE = 8, 0.25  # points that must be, as many as tracks need, and of those tried: chance finds some of a hundred on compressed film [chosen]
INNER_SHARE = 0.5  # of the half width: so far inside, grey levels are looked at [chosen]
FINE_PX, LEAST_GREY = 3.0, 1.5  # what is finer than this is texture, and its grey levels (root mean square): compressed film has .5 to .8 on a plain object [chosen]
ROUGH_GREY = 4.0  # grey levels of it that half the surface has where it is textured: noise of a camera has less [chosen]


def plain(frames: np.ndarray, mask: np.ndarray, matching: Matching, *, spacing_px: int) -> bool:
    """Whether the object `mask` (H, W) of the first of frames (T, H, W, 3) is plain, shading and folds apart: half of its surface has hardly any
    fine grey, or what it has is not found again. Nothing at all is not plain."""
    fine = _fine(frames[0], _depth(mask))
    if not len(fine):
        return False
    usual = 1.4826 * float(np.median(np.abs(fine)))
    return usual < LEAST_GREY or (usual < ROUGH_GREY and not followed(frames, mask, matching, spacing_px=spacing_px))


def followed(frames: np.ndarray, mask: np.ndarray, matching: Matching, *, spacing_px: int) -> bool:
    """Whether enough points inside the object `mask` (H, W) of the first of frames (T, H, W, 3) can be followed."""
    depth = _depth(mask)
    fine = _fine(frames[0], depth)
    if not len(fine) or fine.std() < LEAST_GREY:
        return False
    images = [normalised(frame) for frame in frames[::STRIDE][:TRIED]]
    start = seed_points(images[0], depth > min(EDGE_PX, EDGE_SHARE * depth.max()), spacing_px=spacing_px, most=MOST_POINTS)
    _, valid = track_pixels(images, start, np.ones(len(images), bool), matching)
    held = valid.mean(0) >= LEAST_SHARE
    return bool(held.sum() >= max(ENOUGH, ENOUGH_SHARE * len(start)))


def _depth(mask: np.ndarray) -> np.ndarray:
    """How far inside each pixel lies [px], (H, W)."""
    return cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]


def _fine(frame: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Grey levels (N,) finer than FINE_PX of the pixels well inside, which lie at `depth` (H, W) [px]."""
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return (grey - cv2.GaussianBlur(grey, (0, 0), FINE_PX))[depth > INNER_SHARE * depth.max()]
