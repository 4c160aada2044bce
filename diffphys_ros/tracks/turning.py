"""Points of an object that turns, as seen by who turns along."""

from __future__ import annotations

import numpy as np

from ..rigid_motion import rigid_motion

LEAST_POINTS = 4  # that tell a turn


def turned_back(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Positions (T, M, 3) [m] without the motion of the whole since frame 0, where enough points hold (T, M): what is left is how the object deforms."""
    still = points.copy()
    for k in range(1, len(points)):
        holds = valid[k]
        if holds.sum() >= LEAST_POINTS:
            turn, (before, now) = rigid_motion(points[0, holds], points[k, holds])
            still[k] = (points[k] - now) @ turn + before
    return still
