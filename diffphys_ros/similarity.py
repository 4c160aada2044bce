"""How points move as a whole: a turn, a shift and, where it may be, a scale."""

from __future__ import annotations

import numpy as np

ROUNDS = 10  # of reweighting


def robust_similarity(source: np.ndarray, target: np.ndarray, *, scaled: bool = True) -> np.ndarray:
    """The similarity (d + 1, d + 1) of least absolute distances from points (P, d) to points (P, d), by reweighted least squares: few that go elsewhere do
    not count. Without a scale of its own a rigid motion."""
    d, weight = source.shape[1], np.ones(len(source))
    for _ in range(ROUNDS):
        similarity = fitted_similarity(source, target, weight, scaled=scaled)
        distance = np.linalg.norm(target - source @ similarity[:d, :d].T - similarity[:d, d], axis=1)
        weight = 1 / np.maximum(distance, max(float(np.median(distance)), 1e-12))
    return similarity


def fitted_similarity(source: np.ndarray, target: np.ndarray, weight: np.ndarray, *, scaled: bool = True) -> np.ndarray:
    """The similarity (d + 1, d + 1) of least weighted squares (Umeyama 1991); never a mirror."""
    share, d = (weight / weight.sum())[:, None], source.shape[1]
    centre_s, centre_t = (share * source).sum(0), (share * target).sum(0)
    arm_s, arm_t = source - centre_s, target - centre_t
    u, value, vt = np.linalg.svd((share * arm_t).T @ arm_s)
    sign = np.ones(d)
    sign[-1] = np.sign(np.linalg.det(u @ vt))
    size = float((share * arm_s**2).sum())
    scale = float(value @ sign) / size if scaled and size > 0 else 1.0
    similarity = np.eye(d + 1)
    similarity[:d, :d] = scale * (u * sign) @ vt
    similarity[:d, d] = centre_t - similarity[:d, :d] @ centre_s
    return similarity
