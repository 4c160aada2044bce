"""Does something hold an object that nobody says is held? The middle of what nothing holds moves with a steady acceleration when no force acts."""

from __future__ import annotations

import numpy as np

from .coordinates import Motion

WHOLE_SHARE = 0.5  # of the free swing that is common to all points: .78 on a bar held at one end, 0 on a free one; a surface is not all of a body [derived]
LEAST_FRAMES = 8  # free, of which a parabola takes three [chosen]


def swings_as_a_whole(motion: Motion, forced: np.ndarray) -> bool:
    """Whether the points swing together, about a place of their own, in the frames after the last forced one; forced bool (T,)."""
    acting = np.flatnonzero(forced)
    first = int(acting[-1]) + 1 if len(acting) else 0
    frames = first + np.flatnonzero(motion.known[first:])
    if len(frames) < LEAST_FRAMES:
        return False
    q = motion.coordinates[frames]
    flight = np.vander((frames - frames[0]) / (frames[-1] - frames[0]), 3)
    swing = (q - flight @ np.linalg.lstsq(flight, q, rcond=None)[0]) @ np.moveaxis(motion.shapes, 2, 1)  # (M, K, 3)
    whole, each = (swing.mean(0) ** 2).sum(1).mean(), (swing**2).sum(2).mean()
    return bool(whole > WHOLE_SHARE**2 * each)
