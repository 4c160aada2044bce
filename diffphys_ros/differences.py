"""Derivatives by differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

STEP = 1e-4  # of unknowns of order one


def differences(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, *, step: np.ndarray | float = STEP, least: np.ndarray | float = -np.inf) -> np.ndarray:
    """Central differences (..., n) of an array (...) by its unknowns (n,); from one side, or nearly, where the other lies below `least`."""
    up = np.broadcast_to(np.asarray(step, float), at.shape)
    down = np.minimum(up, at - least)
    return np.stack([(function(at + a) - function(at - b)) / (a + b).sum() for a, b in zip(np.diag(up), np.diag(down), strict=True)], -1)
