"""Symmetric systems of equations that may be singular: what nothing tells of stays as it is. numpy only."""

from __future__ import annotations

import numpy as np


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x (n,) of matrix @ x = right for a symmetric matrix (n, n); the shortest least-squares solution where that is singular.

    Raises ValueError for numbers that are not finite.
    """
    if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
        raise ValueError("the equations hold numbers that are not finite")
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def inverted(matrix: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of a symmetric matrix; where that is singular its pseudo-inverse. Raises ValueError for numbers that are not finite."""
    if not np.isfinite(matrix).all():
        raise ValueError("the matrix holds numbers that are not finite")
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, hermitian=True))
