"""What a motion is compared with, a file a kind: tracks, pixels (colours and depth).

A kind is a function of what it may ask for (`Told`) to its term, or to None where the clip has nothing of the kind; a term gives weighted
misfits by name. All have one unit, half a mean squared misfit over the mean squared motion: the frozen first frame costs .5 in tracks.
"""

from __future__ import annotations

from collections.abc import Callable

from .pixels import pixel_evidence
from .told import Evidence, Moved, Told
from .tracks import track_evidence

EVIDENCE: dict[str, Callable[[Told], Evidence | None]] = {"tracks": track_evidence, "pixels": pixel_evidence}

__all__ = ["EVIDENCE", "Evidence", "Moved", "Told"]
