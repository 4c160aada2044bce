"""Surface depth from the recording's own depth images."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..local_plane import plane_depth
from ..types import Clip
from .scale import DEPTH_TOPIC, DepthSource

WINDOW_RADIUS_PX = 2


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
    """The same depth image with the mask's unknown pixels (0) filled by averages of inverse depth over growing windows."""
    known = (depth > 0) & mask
    inverse = np.where(known, 1 / np.maximum(depth, 1e-6), 0.0)
    sigma = 1.0
    while (mask & ~known).any():
        share = cv2.GaussianBlur(known.astype(np.float64), (0, 0), sigma)
        mean = cv2.GaussianBlur(inverse, (0, 0), sigma) / np.maximum(share, 1e-12)
        new = mask & ~known & (share > 1e-3)
        inverse[new], sigma = mean[new], sigma * 1.5
        known |= new
    return np.where(mask, 1 / np.maximum(inverse, 1e-6), 0.0)
