"""How far tracks may be trusted, told by the tracks themselves."""

from __future__ import annotations

import numpy as np

RANK = 8  # smooth motion of a solid in few modes and their squares: what is left is noise
ORDER = 6  # of the time difference that removes a motion of a few hertz at 30 frames a second


def displacement_noise(points: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of one coordinate of a displacement [m].

    Independent part: the residual of the displacements after the leading principal components. Coherent part: what those
    components carry at the highest temporal frequencies, where a solid body filmed at its frame rate moves little.
    Points (T, M, 3) [m], valid (T, M).
    """
    matrix = _complete(points, valid)
    rank = min(RANK, min(matrix.shape) // 3)
    if rank < 1:
        return 0.0
    u, s, _ = np.linalg.svd(matrix, full_matrices=False)
    share = max((1 - rank / matrix.shape[0]) * (1 - rank / matrix.shape[1]), 1e-3)
    independent = (s[rank:] ** 2).sum() / (matrix.size * share)
    return float(np.sqrt(independent + _rough_part(u[:, :rank] * s[:rank], matrix.shape[1])))


def _complete(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    whole = valid.mean(0) >= np.quantile(valid.mean(0), 0.5)
    frames = valid[:, whole].mean(1) > 0.5
    displacement = (points - points[0])[frames][:, whole] * valid[frames][:, whole, None]
    return displacement.reshape(len(displacement), -1)


def _rough_part(components: np.ndarray, columns: int) -> float:
    if len(components) <= ORDER + 1:
        return 0.0
    gain = float((np.diff(np.eye(ORDER + 1), ORDER, axis=0) ** 2).sum())
    rough = np.diff(components, ORDER, axis=0) ** 2 / gain
    return float(np.median(rough, 0).sum() / 0.455 / columns)  # 0.455: median of a chi-square of one degree
