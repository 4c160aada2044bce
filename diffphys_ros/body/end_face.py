"""How far the held end leans off the face of its box, read from the outline.

A box along the world's axes says where a body is held; a bar that is clamped askew ends in a plane that is no face of the box. What
is held decides how stiff it looks: across the lean a bar whose clamp is taken to be level bends up to 10 % too fast or too slow.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

MOST_LEAN = np.deg2rad(40.0)
LEAST_LEAN = np.deg2rad(2.0)  # what half a pixel makes of an end of some fifteen
ON_EDGE_PX = 1.0  # distance from the line of what still lies on it
STRAIGHT_SHARE = 0.6  # of the columns over the box, without those of the sides, that must end on one line
LEAST_COLUMNS = 8
THROUGH_PX = 3.0  # distance from the told centre at which the line must pass: else what ends there is not the held face
TRIED = 40  # columns of whose pairs lines are tried


def lean_of_end(front: np.ndarray, footprint_m: float, half_width_m: float) -> float:
    """Angle [rad] by which the end of the front leans off the plane x = 0, about z; 0 where the outline ends level, hidden, or on no line.

    Args:
        front: x and y of the visible points of the front face in the body's frame [m], shape (P, 2); the held face has its centre at 0.
        footprint_m: side of a pixel on them.
        half_width_m: of the box, along y.
    """
    y, x = lowest(front[np.abs(front[:, 1]) <= half_width_m], footprint_m)
    near = np.abs(x) <= half_width_m * np.tan(MOST_LEAN)
    y, x = y[near], x[near]
    if len(y) < LEAST_COLUMNS:
        return 0.0
    line = _line(y, x, footprint_m)
    if line is None:
        return 0.0
    slope, offset = line
    lean = float(np.arctan(slope))
    off = (x - offset - slope * y) * np.cos(lean) / (ON_EDGE_PX * footprint_m)
    on = np.abs(off) <= 1
    straight = on.sum() >= LEAST_COLUMNS and on[_end(on, off)].mean() >= STRAIGHT_SHARE
    seen = straight and abs(offset) * np.cos(lean) <= THROUGH_PX * footprint_m
    return lean if seen and LEAST_LEAN <= abs(lean) <= MOST_LEAN else 0.0


def _end(on: np.ndarray, off: np.ndarray) -> slice:
    """The columns of an end whose line some are `on`: those between the first and the last of them, where all others lie above it (`off` is positive), as the
    sides of a narrow body do that leaves a wide box askew; else all."""
    first, last = np.flatnonzero(on)[[0, -1]]
    beyond = np.r_[off[:first], off[last + 1 :]]
    return slice(first, last + 1) if (beyond > 0).all() else slice(None)


def lowest(points: np.ndarray, width_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns of points (P, 2) of that width: their y, and the least x in each."""
    column = np.floor(points[:, 1] / width_m).astype(int)
    order = np.lexsort((points[:, 0], column))
    there, first = np.unique(column[order], return_index=True)
    return (there + 0.5) * width_m, points[order[first], 0]


def _line(y: np.ndarray, x: np.ndarray, footprint_m: float) -> tuple[float, float] | None:
    """Slope and offset of the line through the told centre near which most columns end, fitted to those; None without one."""
    some = np.unique(np.linspace(0, len(y) - 1, TRIED).astype(int))
    first, second = np.array(list(combinations(some, 2))).T
    slopes = (x[second] - x[first]) / (y[second] - y[first])
    offsets, across = x[first] - slopes * y[first], footprint_m * np.hypot(1.0, slopes)
    through = np.abs(offsets) <= THROUGH_PX * across
    if not through.any():
        return None
    misses = np.abs(x - offsets[through, None] - slopes[through, None] * y)
    on = misses <= ON_EDGE_PX * across[through, None]
    best = on[on.sum(1).argmax()]
    slope, offset = np.polyfit(y[best], x[best], 1)
    return float(slope), float(offset)
