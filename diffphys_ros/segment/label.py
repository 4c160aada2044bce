"""From frames to label images: object mask of frame 0, its parts, both carried through the clip."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..config import Settings
from ..errors import InputError
from ..picture import side_of
from ..plainness import plain
from ..types import IGNORE, Clip, object_mask
from .even import labels_by_colour
from .flow import flow_mask
from .given import given_mask
from .motion import motion_mask
from .otsu import otsu_mask
from .parts import most_parts, numbered, split_parts
from .prompt import NO_MARK, Mark
from .propagate import MATCHING, SPACING_PX, propagate
from .regions import pixel_grid
from .sam import sam_mask
from .sam_parts import sam_parts

LEAST_SIDE_PX = 32  # of a frame: OpenCV's optical flow reads beyond the images of its pyramid where one is a narrow strip

METHODS: dict[str, Callable[[Clip, Settings, Mark], np.ndarray]] = {
    "flow": flow_mask,
    "given": given_mask,
    "motion": motion_mask,
    "otsu": otsu_mask,
    "sam": sam_mask,
}


WORDS = {
    "flow": "what moves, by optical flow",
    "given": "as it was drawn",
    "motion": "what moves, grown along its colours",
    "otsu": "by a threshold of brightness",
    "sam": "by the segmentation model",
}


def label_clip(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Label images of the whole clip, uint8 (T, H, W): 0 background, 1..n parts with 1 at the clamp, 255 ignore.

    The object mask of frame 0 is the marked one, else comes from `segment.method`; a mask without parts is split by colour into at most
    `most_parts` connected parts; optical flow carries both through the clip, or where the object is plain its colours. Raises InputError where no object is found,
    and for frames too small to see motion.
    """
    height, width = clip.frames.shape[1:3]
    if min(height, width) < LEAST_SIDE_PX:
        raise InputError(
            f"{clip.source or 'clip'}: the frames have {width} x {height} pixels, needs at least {LEAST_SIDE_PX} a side to see motion; film the object larger"
        )
    mask = _without_held(METHODS[_method(clip, settings, mark)](clip, settings, mark), settings)
    first = first_labels(mask, clip, settings)
    even = labels_by_colour(clip.frames, clip.seen, first) if plain(clip.frames, object_mask(first), MATCHING, spacing_px=SPACING_PX) else None
    return propagate(clip.frames, clip.seen, first, clip.depth) if even is None else even


def first_labels(mask: np.ndarray, clip: Clip, settings: Settings) -> np.ndarray:
    """Label image of frame 0, uint8 (H, W), from a mask that has parts already or is to be split by colour."""
    if np.setdiff1d(np.unique(mask), (0, 1, IGNORE)).size:
        return mask
    parts = sam_parts(clip.frames[0], mask == 1, settings) if _by_model(settings) else None
    if parts is None:
        parts = split_parts(clip.frames[0], mask == 1, max_parts=most_parts(settings))
    parts = numbered(parts, _clamp_pixel(clip, settings))
    return np.where(mask == IGNORE, IGNORE, parts).astype(np.uint8)


def _by_model(settings: Settings) -> bool:
    """Whether the segmentation model tells the parts: in the published configuration, where there is one; stiffness is told by parts of one colour."""
    return settings.experiment.published and bool(settings.segment.model) and settings.segment.max_parts > 1


def described(clip: Clip, settings: Settings, labels: np.ndarray) -> str:
    """What drew the object of label images (T, H, W), a sentence, and what is told and not looked at; empty where `segment.method` is auto."""
    if settings.segment.method == "auto":
        return ""
    method, parts = _method(clip, settings, NO_MARK), int(np.setdiff1d(labels[0], (0, IGNORE)).size)
    told = [name for name, there in (("scene.first_mask", settings.scene.first_mask), ("topics.mask", clip.first_labels is not None)) if there and method != "given"]
    source = "the segmentation model, else colour" if _by_model(settings) else "colour"
    unread = f"; {' and '.join(told)} not looked at" if told else ""
    return f"object: {WORDS[method]} (segment.method {settings.segment.method}), {parts} part(s) by {source}{unread}"


def _method(clip: Clip, settings: Settings, mark: Mark) -> str:
    """Name of what draws the object in frame 0. Raises InputError for one that does not exist."""
    if mark.labels is not None:
        return "given"
    method = settings.segment.method
    if method == "auto":
        return "given" if settings.scene.first_mask or clip.first_labels is not None else "sam" if settings.segment.model else "motion"
    if method == "flow" and settings.segment.model:
        return "sam"
    if method not in METHODS:
        raise InputError(f"segment.method is {method!r}, must be one of {', '.join(METHODS)}")
    return method


def _without_held(mask: np.ndarray, settings: Settings) -> np.ndarray:
    """A label image (H, W) without what lies beyond the line `scene.clamp_px`, seen from where most of the object is."""
    if settings.scene.clamp_px is None:
        return mask
    side = side_of(settings.scene.clamp_px, pixel_grid(mask.shape))
    free = np.sign(np.median(side[object_mask(mask)])) if object_mask(mask).any() else 1.0
    return np.where(side * (free or 1.0) < 0, 0, mask).astype(mask.dtype)


def _clamp_pixel(clip: Clip, settings: Settings) -> np.ndarray | None:
    """Where the centre of the clamp box lies in the image [px], shape (2,); None without a clamp."""
    box = settings.scene.clamp_box_m
    if settings.scene.clamp_px is not None:
        return np.reshape(settings.scene.clamp_px, (2, 2)).mean(0)
    if box is None:
        return None
    pixel, depth = clip.camera.project(np.reshape(box, (2, 3)).mean(0))
    return pixel if depth > 0 else None
