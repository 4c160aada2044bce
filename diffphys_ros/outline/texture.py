"""Whether an object has texture enough for points on it to be followed, or none at all."""

from __future__ import annotations

from ..config import Settings
from ..matching import Matching
from ..plainness import followed, plain
from ..types import Clip, object_mask


def has_texture(clip: Clip, first: int, settings: Settings) -> bool:
    """Whether points inside the object can be followed from frame `first` on. Needs `clip.labels`."""
    assert clip.labels is not None
    return followed(clip.frames[first:], object_mask(clip.labels[first]), _matching(settings), spacing_px=settings.experiment.track_spacing_px)


def plain_at_first(clip: Clip, settings: Settings) -> bool:
    """Whether the object of frame 0 is plain. Needs `clip.labels`."""
    assert clip.labels is not None
    return plain(clip.frames, object_mask(clip.labels[0]), _matching(settings), spacing_px=settings.experiment.track_spacing_px)


def _matching(settings: Settings) -> Matching:
    return Matching(settings.experiment.track_window_px, settings.experiment.track_round_trip_px)
