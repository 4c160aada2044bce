"""Object mask from what moves in the clip."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import Clip
from .regions import filled, largest

LEAST_MOTION_PX = 1.0  # largest displacement that counts as an object


def motion_mask(clip: Clip, settings: Settings) -> np.ndarray:
    """Object (1) and background (0) of frame 0, uint8 (H, W): the largest moving region, grown over the still root by colour.

    Raises InputError where nothing moves by a pixel.
    """
    motion = accumulated_motion(clip.frames[clip.seen])
    level = float(np.quantile(motion, 0.999))
    if level < LEAST_MOTION_PX:
        raise InputError(
            f"{clip.source or 'clip'}: the largest motion is {level:.2f} px, at least {LEAST_MOTION_PX:g} px is needed to find the object by "
            "motion; give scene.first_mask"
        )
    moving = filled(largest(motion > max(0.5, 0.12 * level)))
    return _refined(clip.frames[0], moving).astype(np.uint8)


def accumulated_motion(frames: np.ndarray, *, most: int = 24) -> np.ndarray:
    """Largest displacement of every pixel of frame 0 over the clip [px], float32 (H, W), by DIS flow."""
    flow_of = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    first = cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
    total = np.zeros(first.shape, np.float32)
    for k in np.unique(np.linspace(1, len(frames) - 1, min(most, len(frames) - 1)).astype(int)):
        flow = flow_of.calc(first, cv2.cvtColor(frames[k], cv2.COLOR_RGB2GRAY), None)
        total = np.maximum(total, np.linalg.norm(flow, axis=-1))
    return total


def _refined(frame: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """GrabCut (Rother et al. 2004) from the moving region: sharp edges, and the still root where its colour continues."""
    reach = max(3, round(0.04 * np.sqrt(moving.sum())))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near = cv2.dilate(moving.astype(np.uint8), kernel) > 0
    sure = cv2.erode(moving.astype(np.uint8), kernel) > 0
    far = cv2.dilate(near.astype(np.uint8), kernel, iterations=4) > 0
    guess = np.full(moving.shape, cv2.GC_BGD, np.uint8)
    guess[far] = cv2.GC_PR_BGD
    guess[moving] = cv2.GC_PR_FGD
    guess[sure] = cv2.GC_FGD
    cv2.setRNGSeed(0)
    cv2.grabCut(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), guess, None, np.zeros((1, 65)), np.zeros((1, 65)), 4, cv2.GC_INIT_WITH_MASK)
    found = (guess == cv2.GC_FGD) | (guess == cv2.GC_PR_FGD)
    return filled(largest(found))
