"""The door of the room: which depth source a clip has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..config import Settings
from ..types import IGNORE, Clip
from .inflate import inflated_depth
from .topic import topic_depth

SOURCES: dict[str, Callable[[Clip, np.ndarray, Settings], tuple[np.ndarray, str]]] = {"topic": topic_depth, "inflate": inflated_depth}


def surface_depth(clip: Clip, settings: Settings) -> tuple[np.ndarray, str]:
    """Depth of the object's surface in frame 0 [m], float32 (H, W), 0 off the object; and what it comes from, in words.

    Needs `clip.labels`. Raises InputError where a depth topic says nothing about the object.
    """
    if clip.labels is None:
        raise ValueError("surface_depth needs clip.labels; run segment.label_clip first")
    mask = (clip.labels[0] > 0) & (clip.labels[0] != IGNORE)
    return SOURCES["topic" if clip.depth is not None else "inflate"](clip, mask, settings)
