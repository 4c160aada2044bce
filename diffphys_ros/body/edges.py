"""How much of each edge pixel the object covers: a binary mask made sub-pixel by the colours on either side."""

from __future__ import annotations

import cv2
import numpy as np

LEAST_CONTRAST = 24.0  # grey levels between object and background, below which a pixel keeps its binary value
SIDE_REACH_PX = 3  # how far from the edge the two colours are read


def coverage(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Share of each pixel that the object covers, float32 (H, W), 0 or 1 except at the mask's edge.

    An edge pixel mixes the colour of the object just inside with that of the background just outside; its place between the two is
    the share. Only the pixels on either side of the mask's edge change, so the result is never further than a pixel from the mask.
    RGB frame (H, W, 3), bool mask (H, W).
    """
    solid = mask.astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    inner, outer = cv2.erode(solid, cross) > 0, cv2.dilate(solid, cross) == 0
    band = ~inner & ~outer
    image = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB).astype(np.float32)
    front, front_known = _mean_near(image, inner & ~_eroded(solid, SIDE_REACH_PX))
    back, back_known = _mean_near(image, outer & ~_eroded(1 - solid, SIDE_REACH_PX))
    contrast = front - back
    strength = (contrast**2).sum(-1)
    share = np.clip(((image - back) * contrast).sum(-1) / np.maximum(strength, 1e-3), 0, 1)
    usable = band & front_known & back_known & (strength > LEAST_CONTRAST**2)
    return np.where(usable, share, mask).astype(np.float32)


def _eroded(solid: np.ndarray, reach: int) -> np.ndarray:
    return cv2.erode(solid, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) > 0


def _mean_near(image: np.ndarray, where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean colour of the marked pixels in each neighbourhood (H, W, 3), and where there is one."""
    size = (2 * SIDE_REACH_PX + 1,) * 2
    share = cv2.boxFilter(where.astype(np.float32), -1, size, normalize=False)
    total = cv2.boxFilter(image * where[..., None].astype(np.float32), -1, size, normalize=False)
    return total / np.maximum(share, 1)[..., None], share > 0.5
