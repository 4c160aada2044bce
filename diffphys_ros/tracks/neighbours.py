"""What the points around a point do: the yardstick for outliers."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 9  # points whose median a point is compared with


def neighbour_median(start: np.ndarray, values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Median of values (M, C) over the nearest good points (M,) of positions start (M, d); zeros where too few are good."""
    if good.sum() < NEIGHBOURS:
        return np.zeros_like(values)
    _, index = cKDTree(start[good]).query(start, k=NEIGHBOURS)
    return np.median(values[good][index], 1)
