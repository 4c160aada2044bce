"""The labelling as it runs in a process of its own, which takes its memory along: it needs no ROS."""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import numpy as np

from diffphys_ros.config import Settings
from diffphys_ros.types import Clip

if TYPE_CHECKING:
    from diffphys_ros.segment import Mark


def label(clip: Clip, settings: Settings, mark: Mark) -> Generator[Any, None, np.ndarray]:
    """News, then the label images (T, H, W) of a clip that is placed: those that a fit works with."""
    from diffphys_ros.plain_swing import plain_swing
    from diffphys_ros.segment import label_clip

    yield f"labelling {len(clip)} frames"
    swing = plain_swing(clip, settings)
    if swing is None:
        return label_clip(clip, settings, mark)
    yield "the object is plain and swings: what it is follows from its brightness, whatever was marked"
    labels = swing[0].labels
    assert labels is not None
    return labels
