"""The door of the room: which depth source a clip has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..config import Settings
from ..measured import scene_of
from ..picture import told_in_picture
from ..types import Clip, object_mask
from .capture import captured_depth, registered
from .inflate import inflated_depth
from .network import network_depth
from .plane import flat_depth
from .scale import DepthSource
from .topic import topic_depth

SOURCES: dict[str, Callable[[Clip, np.ndarray, Settings], tuple[np.ndarray, DepthSource]]] = {
    "topic": topic_depth,
    "capture": captured_depth,
    "network": network_depth,
    "inflate": inflated_depth,
    "plane": flat_depth,
}


def surface_depth(clip: Clip, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth of the object's surface in frame 0 [m], float32 (H, W), 0 off the object; and what it and its scale come from.

    Needs `clip.labels`. Raises InputError where the source that `depth.source` names, or auto finds, says nothing about the object.
    """
    if clip.labels is None:
        raise ValueError("surface_depth needs clip.labels; run segment.label_clip first")
    mask, settings = object_mask(clip.labels[0]), replace(settings, scene=scene_of(clip, settings.scene))
    return SOURCES[source_of(clip, settings)](clip, mask, settings)


def placed(clip: Clip, settings: Settings) -> Clip:
    """The clip as every stage after reading takes it: where the depth source is a capture, with the capture's camera, without lens
    distortion and with the thickness measured there (see `registered`); with gravity where the picture says it (see `told_in_picture`)."""
    return told_in_picture(registered(clip, settings) if source_of(clip, settings) == "capture" else clip, settings.scene)


def source_of(clip: Clip, settings: Settings) -> str:
    """The name in SOURCES that `depth.source` stands for: the best that the clip allows where it is auto."""
    if settings.depth.source != "auto":
        return settings.depth.source
    if clip.depth is not None:
        return "topic"
    return "capture" if settings.depth.capture else "network" if settings.depth.model else "inflate"
