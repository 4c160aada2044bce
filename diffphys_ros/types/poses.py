"""Rigid transforms."""

from __future__ import annotations

import numpy as np


def transformed(a_from_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Coordinates in a, (..., 3), of points (..., 3) given in b; the transform is (4, 4)."""
    return points @ a_from_b[:3, :3].T + a_from_b[:3, 3]
