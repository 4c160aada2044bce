"""The frames that were kept back, and what is observed in them. Nothing of this is known to the fit, which has ended by now."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..bags.read import read_clip
from ..config import FrameSettings, Settings
from ..depth import placed
from ..inverse import Prepared
from ..segment import Mark, label_clip
from ..tracks import follow_on, on_tripod
from ..types import Clip, Tracks


@dataclass(frozen=True)
class HeldOut:
    """A recording with its held-out frames at the end."""

    clip: Clip  # all frames, with labels
    tracks: Tracks  # the points that were fitted, in all frames
    fitted: int  # frames from the first on

    @property
    def count(self) -> int:
        """Frames that were kept back."""
        return len(self.clip) - self.fitted


def held_out(source: str | Path, prepared: Prepared, settings: Settings) -> HeldOut:
    """Reads the recording once more, now with the frames kept back. The fit's own mask of frame 0 and its own points are followed on into
    them. Raises InputError."""
    wanted = settings.frames
    clip = placed(read_clip(source, settings, frames=FrameSettings(every=wanted.every, fit=wanted.fit and wanted.fit + wanted.predict)), settings)
    if prepared.clip.depth is None:
        clip = replace(clip, depth=None)
    assert prepared.clip.labels is not None
    clip = clip.with_labels(label_clip(clip, settings, Mark(labels=prepared.clip.labels[0])))

    def followed(seen: Clip) -> Tracks:
        return follow_on(seen, prepared.tracks, prepared.depth0, settings)

    held = on_tripod(clip, followed(clip), followed)
    return HeldOut(held.clip, held.tracks, len(prepared.clip))


def judged_tracks(held: HeldOut) -> tuple[Tracks, np.ndarray]:
    """Tracks of frame 0 and the held-out frames, held to be valid only in these and where they hold in the last fitted frame too; and
    their displacements (M, 3) [m] there. Frame 0 is where displacements are from, and counts for nothing."""
    seen = held.clip.seen[: held.fitted]
    last = int(np.flatnonzero(seen)[-1])
    rows = np.r_[0, held.fitted : len(held.clip)]
    valid = held.tracks.valid[rows] & held.clip.seen[rows, None] & held.tracks.valid[last]
    valid[0] = False
    tracks = replace(held.tracks, pixels=held.tracks.pixels[rows], points=held.tracks.points[rows], valid=valid)
    return tracks, held.tracks.points[last] - held.tracks.points[0]
