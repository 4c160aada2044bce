"""Labels of an untextured object that swings before a scene of another brightness: one grey level for the whole clip, frame by frame.

Flow and colour models need texture; a plain object has none, but it sweeps over the scene. What is swept over tells the grey level
between object and scene, and which of the regions on the object's side of it is the one that moves.
"""

from __future__ import annotations

import cv2
import numpy as np

from ..types import Clip

SAMPLED = 48  # frames in which what moves is looked for [numerical]
SWEPT = (5, 95)  # percentiles over them whose distance tells how much a pixel changes [chosen]
LEAST_CHANGE = 12.0  # grey levels that a pixel must change by to be swept over: noise of dim 8-bit film spreads by 5 [chosen]
AROUND_PX = 9  # that the swept region is widened by: the object's still root is asked as well [chosen]
SPECK_PX = 3  # side of the window in which single pixels are no object [chosen]
LEAST_PX = 50  # of an object, as everywhere [chosen]
MOST_BORDER = 0.25  # of the picture's border that an object may hold: more is a part of the scene of the object's brightness [chosen]
ALIKE = 0.5  # share of its usual area that an object may gain or lose in a frame [chosen]


def grey_of(frames: np.ndarray) -> np.ndarray:
    """Luma of RGB frames (..., 3) uint8, not rounded, float32 (...)."""
    return frames @ np.array([0.299, 0.587, 0.114], np.float32)


def plain_labels(clip: Clip) -> np.ndarray | None:
    """Label images (T, H, W) uint8, 1 on the object; None where nothing plain swings before the scene."""
    chosen = np.flatnonzero(clip.seen)[np.linspace(0, clip.seen.sum() - 1, min(SAMPLED, clip.seen.sum())).astype(int)]
    sample = grey_of(clip.frames[chosen])
    swept = _swept(sample)
    if swept is None:
        return None
    region = cv2.dilate(swept.astype(np.uint8), np.ones((2 * AROUND_PX + 1,) * 2)) > 0
    level, _ = cv2.threshold(sample[:, region].astype(np.uint8).ravel(), 0, 255, cv2.THRESH_OTSU)
    found = [np.stack([_object(side * (grey - level), swept) for grey in sample]) for side in (1, -1)]
    border = [_on_border(masks) for masks in found]
    if min(border) > MOST_BORDER:
        return None
    side = (1, -1)[int(np.argmin(border))]
    labels = np.stack([_object(side * (grey_of(frame) - level), swept) for frame in clip.frames]).astype(np.uint8)
    area = labels.sum((1, 2), dtype=int)
    usual = float(np.median(area))
    return labels if usual >= LEAST_PX and (np.abs(area - usual) <= ALIKE * usual).mean() > 1 - ALIKE / 2 else None


def _swept(sample: np.ndarray) -> np.ndarray | None:
    """The largest region of pixels (H, W) that change over frames (K, H, W); None where nothing does."""
    low, high = np.percentile(sample, SWEPT, axis=0)
    changed = cv2.morphologyEx((high - low > LEAST_CHANGE).astype(np.uint8), cv2.MORPH_OPEN, np.ones((SPECK_PX, SPECK_PX), np.uint8))
    closed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((2 * AROUND_PX + 1,) * 2, np.uint8))
    count, regions, stats, _ = cv2.connectedComponentsWithStats(closed)
    if count < 2:
        return None
    largest = regions == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
    return (changed > 0) & largest if (changed[largest] > 0).sum() >= LEAST_PX else None


def _object(above: np.ndarray, swept: np.ndarray) -> np.ndarray:
    """The region (H, W) above 0 that holds most of what is swept over."""
    _, regions = cv2.connectedComponents((above > 0).astype(np.uint8), connectivity=4)
    size = np.bincount(regions[swept], minlength=2)
    size[0] = 0
    return regions == size.argmax() if size.any() else np.zeros(above.shape, bool)


def _on_border(masks: np.ndarray) -> float:
    """Share of the picture's border that masks (K, H, W) hold: a scene holds nearly all of it, an object little."""
    return float(np.concatenate([masks[:, edge].reshape(-1) for edge in (0, -1)] + [masks[:, :, edge].reshape(-1) for edge in (0, -1)]).mean())
