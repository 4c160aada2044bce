"""Points of an object that turns, as seen by who turns along."""

from __future__ import annotations

import numpy as np

from ..similarity import robust_similarity

LEAST_POINTS = 4  # that tell a turn


def turned_back(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Positions (T, M, 3) [m] without the motion of the whole since frame 0, where enough points hold (T, M): what is left is how the object deforms."""
    still = points.copy()
    for k in range(1, len(points)):
        holds = valid[k]
        if holds.sum() >= LEAST_POINTS:
            motion = robust_similarity(points[0, holds], points[k, holds], scaled=False)
            still[k] = (points[k] - motion[:3, 3]) @ motion[:3, :3]
    return still
