"""A clip seen by its outline, without the motion of the hand that holds its camera: by the background where that tells it, else by the outline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..types import Clip, Tracks

if TYPE_CHECKING:
    from ..outline import Sway
    from ..tracks import CameraMotion

APART = 0.5  # of what the background shows of the camera's motion, by which the outline may say another one: hardly any background is off by that much [chosen]


@dataclass(frozen=True)
class Steadied:
    """A clip as a camera on a tripod would have seen it, as far as that can be told."""

    clip: Clip
    moved: CameraMotion | None = None  # how the camera did, where that was not taken off
    sway: Sway | None = None  # what was taken off by the outline


def steadied(clip: Clip, follow: Callable[[Clip], Tracks]) -> Steadied:
    """Of a clip with labels, whose outline `follow` follows."""
    from ..outline import sway_of
    from ..tracks import laid_over_first, on_tripod

    tracks = follow(clip)
    held = on_tripod(clip, tracks, follow)
    if held.clip is not clip and held.moved is None:  # the background tells it well
        return Steadied(held.clip)
    sway = sway_of(clip, tracks)
    if sway is None or not sway.size_px or not _agree(sway, held.moved):
        return Steadied(held.clip, held.moved)
    matrix = np.concatenate([np.broadcast_to(np.eye(2), (len(clip), 2, 2)), sway.shift_px[..., None]], -1)
    note = (
        f"the camera, or what holds the object, moves by up to {sway.size_px:.2g} px, which the outline shows and the background does not, or not well: the frames were laid over each "
        f"other by that, each to {sway.sd_px:.2g} px; what of it goes with the swing, {sway.as_swing_px:.2g} px, is in the stated standard deviation; put the camera on a tripod"
    )
    return Steadied(replace(laid_over_first(clip, matrix), notes=(*clip.notes, note)), sway=sway)


def _agree(sway: Sway, moved: CameraMotion | None) -> bool:
    """Whether what an outline shows is what the background does, as far as that shows anything."""
    if moved is None:
        return True
    own = sway.shift_px - sway.shift_px[0]
    apart = np.linalg.norm(own[moved.frames] - moved.shift_px, axis=1)
    return bool(np.median(apart) <= APART * np.linalg.norm(moved.shift_px, axis=1).max())
