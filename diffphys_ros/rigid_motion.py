"""How points move as a whole: a turn and a shift."""

from __future__ import annotations

import numpy as np

ROUNDS = 5  # of reweighting
LEAST_OFF_M = 1e-6  # deviation below which all points weigh alike


def rigid_motion(points: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation R (3, 3) and centre pair (2, 3) [m] with moved - centre[1] near R (points - centre[0]), by least absolute deviations: few that
    move otherwise do not count. Points (M, 3), at least three that do not lie in a line (Kabsch 1976)."""
    weight = np.ones(len(points))
    turn, centres = np.eye(3), np.zeros((2, 3))
    for _ in range(ROUNDS):
        centres = np.stack([np.average(each, axis=0, weights=weight) for each in (points, moved)])
        arm, there = points - centres[0], moved - centres[1]
        u, _, v = np.linalg.svd((weight[:, None] * there).T @ arm)
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
        off = np.linalg.norm(there - arm @ turn.T, axis=1)
        weight = 1 / np.maximum(off, max(float(np.median(off)), LEAST_OFF_M))
    return turn, centres
