"""Surface depth from the recording's own depth images."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..surface_plane import plane_depth
from ..types import Clip
from .scale import DEPTH_TOPIC, DepthSource

WINDOW_RADIUS_PX = 2
PLANE_ROUNDS, PLANE_OFF = 3, 4.0  # of the fit of the object's plane; medians of the distances, beyond which a pixel does not count
LEAST_INVERSE = 0.5  # of the least inverse depth that was measured: a filled pixel is at most twice as far as the farthest


def topic_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels from `clip.depth[0]`: quantisation smoothed by local planes, holes filled.

    Raises InputError where the clip has no depth, or none on the object.
    """
    if clip.depth is None:
        raise InputError(
            f"{clip.source or 'clip'}: has no depth images, depth.source is 'topic'; name the topic with topics.depth or choose another depth.source"
        )
    measured = clip.depth[0]
    v, u = np.nonzero(mask & (measured > 0))
    if not len(v):
        raise InputError(
            f"{clip.source or 'clip'}: the depth image of frame 0 holds no value on the object, needs at least one; "
            "correct topics.depth, or set it to 'none' to go on without depth"
        )
    smooth = np.zeros(measured.shape)
    smooth[v, u] = plane_depth(measured, np.stack([u, v], -1).astype(float), radius=WINDOW_RADIUS_PX, mask=mask)[0]
    return fill_holes(smooth, mask).astype(np.float32), DepthSource(DEPTH_TOPIC, DEPTH_TOPIC)


def fill_holes(depth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The same depth image with the mask's unknown pixels (0) filled: what inverse depth differs by from the object's own plane is averaged
    over growing windows, so that the end of a tilted face, which many cameras cannot see when it is near, goes on in its direction."""
    known = (depth > 0) & mask
    inverse = np.where(known, 1 / np.maximum(depth, 1e-6), 0.0)
    plane = inverse_plane(inverse, known)
    rest, sigma = np.where(known, inverse - plane, 0.0), 1.0
    while (mask & ~known).any():
        share = cv2.GaussianBlur(known.astype(np.float64), (0, 0), sigma)
        mean = cv2.GaussianBlur(rest, (0, 0), sigma) / np.maximum(share, 1e-12)
        new = mask & ~known & (share > 1e-3)
        rest[new], sigma = mean[new], sigma * 1.5
        inverse[new] = np.maximum(plane[new] + rest[new], LEAST_INVERSE * inverse[depth > 0].min())
        known |= new
    return np.where(mask, 1 / np.maximum(inverse, 1e-6), 0.0)


def inverse_plane(inverse: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The plane nearest to a surface's inverse depth (H, W) [1/m] where that is known, as inverse depth everywhere (a plane's is linear in
    the pixels); pixels far off it are left out."""
    v, u = np.nonzero(known)
    basis, value = np.stack([np.ones(len(u)), u, v], -1), inverse[v, u]
    kept = np.ones(len(u), bool)
    for _ in range(PLANE_ROUNDS):
        found = np.linalg.lstsq(basis[kept], value[kept], rcond=None)[0]
        off = np.abs(basis @ found - value)
        kept = off <= max(PLANE_OFF * float(np.median(off)), 1e-9)
    rows, columns = np.indices(inverse.shape)
    return np.asarray(found[0] + found[1] * columns + found[2] * rows)
