"""Points bound to particles by weights that reproduce affine motion (paper A.11)."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 14  # particles that carry a point, where there are as many
SMALLEST_SPREAD = 1e-3  # of the neighbours, relative to their largest, below which a direction is not resolved
LARGEST_MISS = 0.5  # of its neighbours' width, that a point may lie off the plane that they span
LARGEST_WEIGHT = 1.5  # beyond it a point lies too far outside its neighbours for a linear fit: they are then taken from further around


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
        # one particle of each after the other: all k at once would take k times the memory
        carried = (weight[:, j, None] * field.index_select(-2, index[:, j]) for j in range(index.shape[1]))
        return functools.reduce(torch.add, carried)


def bind(points: np.ndarray, x_rest: np.ndarray) -> Binding:
    """Moving-least-squares weights of the k = NEIGHBOURS nearest particles x_rest (P, 3) [m] at points (M, 3) [m].

    Constant and linear fields are reproduced exactly where the neighbours span space (Lancaster and Salkauskas 1981); in a direction that
    they do not span the field is taken as constant. A point far outside is bound to k of the 2 k, 4 k, ... nearest particles, so that it
    goes with a piece of the body about as wide as it is away; where the whole body is not, as a point nearer to it.
    """
    k, tree = min(NEIGHBOURS, len(x_rest)), cKDTree(x_rest)
    among = 2 * k
    found = _bound(points, x_rest, tree, k, k)
    far = np.flatnonzero(_far(found, points, x_rest))
    while len(far) and among < 2 * len(x_rest):
        wider = _bound(points[far], x_rest, tree, k, min(among, len(x_rest)))
        for kept, new in zip((found.index, found.weight, found.gradient), (wider.index, wider.weight, wider.gradient), strict=True):
            kept[far] = new
        far, among = far[_far(wider, points[far], x_rest)], 2 * among
    even, large = 1 / k, np.abs(found.weight[far] - 1 / k).max(1, initial=1.0)
    found.weight[far] = even + (found.weight[far] - even) * (LARGEST_WEIGHT / np.maximum(large, LARGEST_WEIGHT))[:, None]
    return found


def _far(binding: Binding, points: np.ndarray, x_rest: np.ndarray) -> np.ndarray:
    """Points (M, 3) that lie too far from their particles for a linear fit, or off the plane that these span, bool (M,)."""
    near = x_rest[binding.index]
    miss = np.linalg.norm(binding.apply(x_rest) - points, axis=1)
    width = np.linalg.norm(near - near.mean(1, keepdims=True), axis=2).max(1)
    return (np.abs(binding.weight).max(1) > LARGEST_WEIGHT) | (miss > LARGEST_MISS * width)


def _bound(points: np.ndarray, x_rest: np.ndarray, tree: cKDTree, k: int, among: int) -> Binding:
    """Points (M, 3) bound to k particles, evenly chosen by distance among the `among` nearest."""
    ranks = np.linspace(1, among, k).round().astype(int)
    distance, index = tree.query(points, k=ranks)
    scale = np.maximum(1.05 * distance.max(1), 1e-12)[:, None]
    kernel = np.maximum((1 - (distance / scale) ** 2) ** 2, 1e-6)
    weight, gradient = _affine_weights((x_rest[index] - points[:, None]) / scale[..., None], kernel)
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
