"""Object mask by Otsu's threshold on the colour distance from the image's border (the paper's initialisation)."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import Clip
from .prompt import NO_MARK, Mark, Prompt
from .regions import filled

LEAST_SHARE = 0.002  # of the image that an object must cover
NOISE_DISTANCE = 4.0  # Lab units: below it colours are equal, above it ratios count, so that a vivid part does not hide a pale one


def otsu_mask(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): the region that stands out from the border's colours, of several
    the largest or that of the marked point, `segment.box_px` and `segment.point_px`.

    Raises InputError where nothing stands out.
    """
    lab = cv2.cvtColor(cv2.GaussianBlur(clip.frames[0], (0, 0), 1), cv2.COLOR_RGB2LAB).astype(np.float32)
    distance = np.log1p(_distance_from_border(lab) / NOISE_DISTANCE)
    level = np.clip(distance * (255 / max(float(distance.max()), 1e-6)), 0, 255).astype(np.uint8)
    _, above = cv2.threshold(level, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    mask = filled(Prompt.of(settings, mark, clip.frames.shape[1:3]).region(above > 0))
    if not LEAST_SHARE < mask.mean() < 0.9:
        raise InputError(
            f"{clip.source or 'clip'}: Otsu's threshold marks {100 * mask.mean():.1f} % of frame 0 as object, needs between 0.2 and 90 %; "
            "give scene.first_mask or set segment.method to 'motion'"
        )
    return mask.astype(np.uint8)


def _distance_from_border(lab: np.ndarray) -> np.ndarray:
    """Chroma-led distance of every pixel from the nearest of eight typical border colours (H, W)."""
    rim = max(4, min(lab.shape[:2]) // 24)
    border = np.concatenate([lab[:rim].reshape(-1, 3), lab[-rim:].reshape(-1, 3), lab[:, :rim].reshape(-1, 3), lab[:, -rim:].reshape(-1, 3)])
    scale = np.array([0.5, 1.0, 1.0], np.float32)  # lightness varies with shading, chroma does not
    cv2.setRNGSeed(0)
    _, _, centres = cv2.kmeans(border * scale, 8, None, (cv2.TERM_CRITERIA_MAX_ITER | cv2.TERM_CRITERIA_EPS, 30, 0.5), 1, cv2.KMEANS_PP_CENTERS)
    return np.min([np.linalg.norm(lab * scale - centre, axis=-1) for centre in centres], 0)
