"""Points bound to particles by weights that reproduce affine motion (paper A.11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

SMALLEST_SPREAD = 1e-3  # of the neighbours, relative to their largest, below which a direction is not resolved
LARGEST_WEIGHT = 4.0  # beyond it a point lies too far outside its neighbours for a linear fit


@dataclass(frozen=True)
class Binding:
    """Weights of k particles at each of M points."""

    index: np.ndarray  # of the particles, int64, shape (M, k)
    weight: np.ndarray  # rows sum to 1, shape (M, k)
    gradient: np.ndarray  # weights of the field's gradient [1/m], rows sum to 0, shape (M, k, 3)

    def apply(self, field: Any) -> Any:
        """The field at the points: (P, C) -> (M, C), or (T, P, C) -> (T, M, C); numpy or torch (differentiable)."""
        if isinstance(field, np.ndarray):
            return np.einsum("mk,...mkc->...mc", self.weight, field[..., self.index, :])
        import torch

        index = torch.as_tensor(self.index, device=field.device)
        weight = torch.as_tensor(self.weight, dtype=field.dtype, device=field.device)
        return torch.einsum("mk,...mkc->...mc", weight, field[..., index, :])


def bind(points: np.ndarray, x_rest: np.ndarray, k: int = 14) -> Binding:
    """Moving-least-squares weights of the k nearest particles x_rest (P, 3) [m] at points (M, 3) [m].

    Constant and linear fields are reproduced exactly where the neighbours span space; in a direction that they do not span, or far
    outside them, the field is taken as constant (Lancaster and Salkauskas 1981).
    """
    k = min(k, len(x_rest))
    distance, index = cKDTree(x_rest).query(points, k=k)
    distance, index = distance.reshape(len(points), k), index.reshape(len(points), k)
    scale = np.maximum(1.05 * distance.max(1), 1e-12)[:, None]
    kernel = np.maximum((1 - (distance / scale) ** 2) ** 2, 1e-6)
    local = (x_rest[index] - points[:, None]) / scale[..., None]
    weight, gradient = _affine_weights(local, kernel)
    far = np.abs(weight).max(1) > LARGEST_WEIGHT
    weight[far] = (kernel / kernel.sum(1, keepdims=True))[far]
    return Binding(index, weight, gradient / scale[..., None])


def _affine_weights(local: np.ndarray, kernel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value (M, k) and gradient (M, k, 3) weights at the origin of local coordinates (M, k, 3)."""
    mean_weight = kernel / kernel.sum(1, keepdims=True)
    centre = np.einsum("mk,mkc->mc", mean_weight, local)
    offset = local - centre[:, None]
    moment = np.einsum("mk,mki,mkj->mij", mean_weight, offset, offset)
    spread, axes = np.linalg.eigh(moment)
    inverse = np.where(spread > SMALLEST_SPREAD * spread[:, -1:], 1 / np.maximum(spread, 1e-30), 0.0)
    solved = np.einsum("mij,mj,mlj->mil", axes, inverse, axes)
    gradient = np.einsum("mk,mkj,mji->mki", mean_weight, offset, solved)
    return mean_weight - np.einsum("mki,mi->mk", gradient, centre), gradient
