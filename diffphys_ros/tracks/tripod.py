"""A hand that holds the camera, taken off: the frames of a clip as a camera on a tripod would have seen them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..steady import Overlay, as_seen_first, overlay
from ..types import IGNORE, Clip, Tracks, object_mask
from .background import LARGEST_STILL_PX, CameraMotion, background, camera_motion

MOST_SHIFT = 0.05  # of the picture's width: further, a hand has carried the camera, and near things move otherwise than far ones
LEAST_AGREED = 0.5  # share of the background's tiles that must say the same: else its parts lie at different distances, or move


@dataclass(frozen=True)
class OnTripod:
    """A clip whose camera stands, and its tracks; or one whose camera moves, as it was."""

    clip: Clip
    tracks: Tracks
    moved: CameraMotion | None  # what was not taken off


def on_tripod(clip: Clip, tracks: Tracks, follow: Callable[[Clip], Tracks]) -> OnTripod:
    """The clip with its frames, depth and labels laid over frame 0 by the background where the camera moves by little, and what `follow`
    makes of it; how far that may be off widens the standard deviations of the tracks. Frame 0 stays as it is.

    What turns the camera (shift, roll, zoom of the picture) is taken off. What carries it moves near things by more than far ones: that is
    left, and seen as unrest of the tracks.
    """
    moved = camera_motion(clip, tracks)
    if moved is None:
        return OnTripod(clip, tracks, None)
    seen = _overlay(clip)
    assert clip.labels is not None
    v, u = np.nonzero(object_mask(clip.labels[0]))
    middle = np.array([u.mean(), v.mean()])
    why = _in_the_way(seen, clip, middle)
    if why:
        return OnTripod(replace(clip, notes=(*clip.notes, why)), tracks, moved)
    shift, sd = np.linalg.norm(seen.shift_px(middle), axis=1), seen.sd_px(middle)
    note = f"the camera moves by up to {shift.max():.2g} px; its frames were laid over frame 0 by the background, each to {np.median(sd[1:]):.2g} px"
    steady = replace(laid_over_first(clip, seen.matrix), notes=(*clip.notes, note))
    again = _less_sure(follow(steady), steady, sd)
    return OnTripod(steady, again, camera_motion(steady, again))


def _overlay(clip: Clip) -> Overlay:
    assert clip.labels is not None
    return overlay([cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32) for frame in clip.frames], [background(labels) for labels in clip.labels])


def _in_the_way(seen: Overlay, clip: Clip, middle: np.ndarray) -> str:
    """Why the camera's motion is not taken off, one sentence; empty where it can be."""
    here = clip.seen
    far, width = float(np.linalg.norm(seen.shift_px(middle), axis=1)[here].max()), clip.frames.shape[2]
    begin = "the camera's motion was not taken off: "
    if seen.agreed[here].min() < LEAST_AGREED:
        frame = int(np.flatnonzero(here)[seen.agreed[here].argmin()])
        return f"{begin}in frame {frame} {seen.agreed[frame]:.0%} of the background agree on it, at least {LEAST_AGREED:.0%} must; have a patterned wall behind the object"
    if far > MOST_SHIFT * width:
        return f"{begin}it shifts the picture by up to {far:.3g} px, at most {MOST_SHIFT * width:.3g} px are; hold the camera still or put it on a tripod"
    worst = float(seen.sd_px(middle)[here].max())
    if worst > LARGEST_STILL_PX:
        return f"{begin}the background tells it to {worst:.2g} px, {LARGEST_STILL_PX:g} px are needed; have a patterned wall behind the object"
    return ""


def laid_over_first(clip: Clip, matrix: np.ndarray) -> Clip:
    """Frames, depth and labels read at `matrix` (T, 2, 3); what the camera did not see there is unknown."""
    assert clip.labels is not None
    frames, labels = clip.frames.copy(), clip.labels.copy()
    depth = None if clip.depth is None else clip.depth.copy()
    size = clip.frames.shape[2], clip.frames.shape[1]
    for k in np.flatnonzero((matrix != np.eye(2, 3)).any((1, 2))):
        frames[k] = as_seen_first(clip.frames[k], matrix[k])
        labels[k] = cv2.warpAffine(clip.labels[k], matrix[k], size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, borderValue=IGNORE)
        if depth is not None:
            depth[k] = cv2.warpAffine(clip.depth[k], matrix[k], size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)  # type: ignore[index]
    return replace(clip, frames=frames, labels=labels, depth=depth)


def _less_sure(tracks: Tracks, clip: Clip, sd_px: np.ndarray) -> Tracks:
    """Tracks whose standard deviations hold that of the camera, (T,) [px], which all of them share."""
    per_px = clip.camera.project(tracks.points[0])[1] / clip.camera.focal_px
    noise = float(np.hypot(tracks.noise_m, np.median(sd_px[1:]) * np.median(per_px)))
    if tracks.sd_m is None:
        return replace(tracks, noise_m=noise)
    sd = tracks.sd_m.copy()
    sd[..., 0] = np.hypot(sd[..., 0], sd_px[:, None] * per_px)
    return replace(tracks, noise_m=noise, sd_m=sd)
