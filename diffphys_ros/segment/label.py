"""From frames to label images: object mask of frame 0, its parts, both carried through the clip."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..types import IGNORE, Clip
from .flow import flow_mask
from .given import given_mask
from .motion import motion_mask
from .otsu import otsu_mask
from .parts import numbered, split_parts
from .prompt import NO_MARK, Mark
from .propagate import propagate
from .sam import sam_mask

LEAST_SIDE_PX = 32  # of a frame: OpenCV's optical flow reads beyond the images of its pyramid where one is a narrow strip

METHODS: dict[str, Callable[[Clip, Settings, Mark], np.ndarray]] = {
    "flow": flow_mask,
    "given": given_mask,
    "motion": motion_mask,
    "otsu": otsu_mask,
    "sam": sam_mask,
}


def label_clip(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Label images of the whole clip, uint8 (T, H, W): 0 background, 1..n parts with 1 at the clamp, 255 ignore.

    The object mask of frame 0 is the marked one, else comes from `segment.method`; a mask without parts is split by colour into at most
    `segment.max_parts` connected parts; optical flow carries both through the clip. Raises InputError where no object is found,
    and for frames too small to see motion.
    """
    height, width = clip.frames.shape[1:3]
    if min(height, width) < LEAST_SIDE_PX:
        raise InputError(
            f"{clip.source or 'clip'}: the frames have {width} x {height} pixels, needs at least {LEAST_SIDE_PX} a side to see motion; film the object larger"
        )
    mask = METHODS[_method(clip, settings, mark)](clip, settings, mark)
    return propagate(clip.frames, clip.seen, first_labels(mask, clip, settings), clip.depth)


def first_labels(mask: np.ndarray, clip: Clip, settings: Settings) -> np.ndarray:
    """Label image of frame 0, uint8 (H, W), from a mask that has parts already or is to be split by colour."""
    if np.setdiff1d(np.unique(mask), (0, 1, IGNORE)).size:
        return mask
    parts = split_parts(clip.frames[0], mask == 1, max_parts=settings.segment.max_parts)
    parts = numbered(parts, _clamp_pixel(clip, settings))
    return np.where(mask == IGNORE, IGNORE, parts).astype(np.uint8)


def _method(clip: Clip, settings: Settings, mark: Mark) -> str:
    """Name of what draws the object in frame 0. Raises InputError for one that does not exist."""
    if mark.labels is not None:
        return "given"
    method = settings.segment.method
    if method == "auto":
        return "given" if settings.scene.first_mask or clip.first_labels is not None else "sam" if settings.segment.model else "motion"
    if method not in METHODS:
        raise InputError(f"segment.method is {method!r}, must be one of {', '.join(METHODS)}")
    return method


def _clamp_pixel(clip: Clip, settings: Settings) -> np.ndarray | None:
    """Where the centre of the clamp box lies in the image [px], shape (2,); None without a clamp."""
    box = settings.scene.clamp_box_m
    if box is None:
        return None
    pixel, depth = clip.camera.project(np.reshape(box, (2, 3)).mean(0))
    return pixel if depth > 0 else None
