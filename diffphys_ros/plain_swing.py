"""Whether a clip shows an object without texture that swings freely: such a one is followed by its outline, from its calm frames on."""

from __future__ import annotations

from .config import Settings
from .errors import InputError
from .outline import Calm, begins_in_motion, calm_part, has_texture
from .segment import plain_labels
from .types import Clip


def is_looked_for(clip: Clip, settings: Settings) -> bool:
    """Whether `tracks.evidence` asks for it; auto does where neither depth nor a clamp box says where the object is."""
    wanted = settings.tracks.evidence
    return wanted == "outline" or (wanted == "auto" and clip.depth is None and settings.scene.clamp_box_m is None)


def plain_swing(clip: Clip, settings: Settings) -> tuple[Clip, Calm] | None:
    """The clip, labelled, and its calm frames; None where points on the object are to be followed. Raises InputError where an outline is asked for
    that tells nothing."""
    if not is_looked_for(clip, settings):
        return None
    asked, name = settings.tracks.evidence == "outline", clip.source or "clip"
    labels = plain_labels(clip)
    if labels is None:
        if asked:
            raise InputError(f"{name}: nothing plain swings before the scene, so that there is no outline to follow; set tracks.evidence to points")
        return None
    labelled = clip.with_labels(labels)
    try:
        calm = calm_part(labels, clip.period_s, rest_frame=settings.scene.rest_frame, source=name)
    except InputError:
        if asked or settings.scene.rest_frame is not None or _needs_calm(labelled, settings):
            raise
        return None
    return None if not asked and has_texture(labelled, calm.rest, settings) else (labelled, calm)


def _needs_calm(labelled: Clip, settings: Settings) -> bool:
    """Whether no other frame than a calm one can show the object at rest, and nothing but its outline can be followed. Not where the object was
    pointed out: the labels then follow that mask, not what is plain."""
    assert labelled.labels is not None
    return labelled.first_labels is None and not settings.scene.at_rest and begins_in_motion(labelled.labels) and not has_texture(labelled, 0, settings)
