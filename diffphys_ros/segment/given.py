"""The object mask that a person or another segmenter gives."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..config import Settings
from ..errors import InputError, shown
from ..types import IGNORE, Clip
from .prompt import NO_MARK, Mark

MOST_BYTES = 256 << 20  # of a mask's file
MOST_PARTS = 16
MASK_TOPIC = "the mask topic"


def given_mask(clip: Clip, settings: Settings, mark: Mark = NO_MARK) -> np.ndarray:
    """Label image of frame 0, uint8 (H, W): the marked one, else the PNG `scene.first_mask`, else that of the clip's mask topic.

    Values 1..n are parts and 255 means ignore; an image with no other values than 0 and 255 is background and object, which is
    returned as 0 and 1. Raises InputError where the file cannot be read, has another size than the frames, is empty, or skips
    a part number.
    """
    if mark.labels is not None:
        return _checked(mark.labels, MASK_TOPIC, clip)
    name = settings.scene.first_mask
    if name:
        return _checked(_read(name), f"scene.first_mask {shown(name)}", clip)
    if clip.first_labels is None:
        raise InputError("segment.method is 'given' but neither scene.first_mask nor a mask topic is; give the path of a PNG or choose 'motion'")
    return _checked(clip.first_labels, MASK_TOPIC, clip)


def _read(name: str) -> np.ndarray:
    try:
        path = Path(name)
        image = cv2.imread(name, cv2.IMREAD_UNCHANGED) if path.is_file() and path.stat().st_size <= MOST_BYTES else None
    except (OSError, ValueError, cv2.error):  # a name too long or with a NUL; a header that promises more pixels than OpenCV takes
        image = None
    if image is None or image.dtype.kind != "u":
        raise InputError(f"scene.first_mask {shown(name)}: not a readable image of whole numbers; give the path of a PNG of the object in frame 0")
    return image[..., :3].max(-1) if image.ndim == 3 else image


def is_object_mask(labels: np.ndarray) -> bool:
    """Whether an image holds only 0 and 255, which stand for background and object."""
    return bool(np.isin(labels, (0, IGNORE)).all())


def _checked(image: np.ndarray, name: str, clip: Clip) -> np.ndarray:
    height, width = clip.frames.shape[1:3]
    if image.shape != (height, width):
        raise InputError(f"{name}: {image.shape[1]} x {image.shape[0]} pixels, must be {width} x {height} as the frames; give a mask of that size")
    if not image.any():
        raise InputError(f"{name}: empty, needs at least one pixel that is not 0; mark the object in frame 0")
    if is_object_mask(image):
        return (image > 0).astype(np.uint8)
    parts = np.setdiff1d(np.unique(image), (0, IGNORE))
    if not np.array_equal(parts, np.arange(1, len(parts) + 1)):
        raise InputError(f"{name}: part numbers {parts[:10].tolist()} must be 1..n without gaps (255: ignore); renumber the parts")
    if len(parts) > MOST_PARTS:
        raise InputError(f"{name}: has {len(parts)} parts, at most {MOST_PARTS} can be told apart by their motion; join some")
    return image.astype(np.uint8)
