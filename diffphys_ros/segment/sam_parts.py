"""Parts of the object by Segment Anything: the masks that it offers for points all over the object (paper section 3.2)."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ..config import Settings
from ..inpaint import nearest_known
from ..pretrained import model_of
from .parts import most_parts, stands_for_itself, whole_pieces
from .sam import ARCHITECTURES, SETTING, offered_at

POINTS_ACROSS = 8  # asked along the longer side of the object's box [chosen]
LEAST_SHARE, MOST_SHARE = 0.03, 0.8  # of the object that a part's mask may cover [chosen]
INSIDE = 0.9  # of a part's mask that must lie on the object [chosen]
NEW = 0.7  # of a mask that no part before it may have [chosen]
SEAM = 0.05  # width, over the root of the object's area, of what no mask covers and is no part but a seam [chosen]
LEAST_QUALITY = 0.7  # intersection over union that the network expects of a mask [chosen]


def sam_parts(frame: np.ndarray, mask: np.ndarray, settings: Settings) -> np.ndarray | None:
    """Part numbers 1..n in no special order, 0 off the mask, uint8 (H, W), from an RGB frame (H, W, 3) and the object's mask (H, W) by the network
    `segment.model`; None where it tells no parts apart."""
    model, config = model_of(str(settings.segment.model), ARCHITECTURES, setting=SETTING, device=settings.fit.device)
    masks, quality = offered_at(model, config, frame, points_on(mask))
    return divided_by(masks.reshape(-1, *mask.shape), quality.ravel(), mask, max_parts=most_parts(settings))


def points_on(mask: np.ndarray) -> np.ndarray:
    """Pixels (P, 2), u and v, of a grid over the box of a mask (H, W) that lie on it."""
    v, u = np.nonzero(mask)
    spacing = max(int(np.ptp(u)), int(np.ptp(v)), 1) / POINTS_ACROSS
    lines = [np.arange(float(each.min()) + spacing / 2, float(each.max()) + 1, spacing) for each in (u, v)]
    grid = np.stack(np.meshgrid(*lines), -1).reshape(-1, 2).round().astype(int)
    inside = grid[mask[grid[:, 1], grid[:, 0]]]
    return (inside if len(inside) else np.stack([u, v], 1)[[len(u) // 2]]).astype(float)


def divided_by(masks: np.ndarray, quality: Sequence[float] | np.ndarray, mask: np.ndarray, *, max_parts: int) -> np.ndarray | None:
    """An object (H, W) divided by the best of the masks (M, H, W) that are parts of it, at most `max_parts`, what no mask covers being one; uint8
    (H, W). None where fewer than two are left."""
    parts, area = np.zeros(mask.shape, np.uint8), mask.sum()
    for k in np.argsort(-np.asarray(quality), kind="stable"):
        if parts.max() == max_parts - 1 or quality[k] < LEAST_QUALITY:
            break
        own = masks[k] & mask
        share = own.sum() / max(area, 1)
        if LEAST_SHARE < share < MOST_SHARE and own.sum() > INSIDE * masks[k].sum() and (parts[own] == 0).mean() > NEW:
            parts[own & (parts == 0)] = parts.max() + 1
    if not parts.any():
        return None
    side = max(3, round(SEAM * np.sqrt(area)))
    rest = cv2.morphologyEx((mask & (parts == 0)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((side, side), np.uint8)) > 0
    if rest.sum() > LEAST_SHARE * area:
        parts[rest] = parts.max() + 1
    parts = whole_pieces(np.where(mask, nearest_known(parts, parts > 0), 0).astype(np.uint8))
    found = np.setdiff1d(np.unique(parts), 0)
    return parts if len(found) > 1 and all(stands_for_itself(parts == part, mask) for part in found) else None
