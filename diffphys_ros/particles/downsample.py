"""Particles as a share of the Gaussians and a dense interior behind them (paper section 4.3, Table 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..types import Body, Particles
from .fill import GHOST_CELLS, fill, grid_order

LLOYD_STEPS = 12  # of k-means; from a bisection, positions then move by less than a hundredth of their distance


@dataclass(frozen=True)
class DensePoints:
    """The Gaussians of the surface and a lattice of the interior, about as far from each other; body frame."""

    x: np.ndarray  # [m], shape (M, 3)
    volume: np.ndarray  # [m^3], shape (M,); sums to the body's, part by part
    part: np.ndarray  # 1..n, shape (M,)


def dense_points(body: Body, surface: np.ndarray) -> DensePoints:
    """Surface points (G, 3) [m], body frame, and an interior of the spacing at which they cover the silhouette.

    A surface point takes an equal share of the volume of the interior point next to it. Those further from the interior than its
    spacing belong to nothing and are left out. Raises InputError without any surface point.
    """
    if not len(surface):
        raise InputError("experiment.downsample_ratio: there are 0 Gaussians to take a share of, needs at least 1; set it to 0 for particles on a lattice")
    spacing = float(np.sqrt(body.silhouette_m2 / len(surface)))
    interior = fill(body, spacing, 1.0)
    own = interior.own
    distance, nearest = cKDTree(interior.x_rest[own]).query(surface)
    near = distance < spacing
    share = 1.0 + np.bincount(nearest[near], minlength=len(own))
    index = np.r_[nearest[near], np.arange(len(own))]
    x = np.concatenate([surface[near], interior.x_rest[own]])
    return DensePoints(x, (interior.volume[own] / share)[index], interior.part[own][index])


def downsample(body: Body, dense: DensePoints, count: int, dx: float) -> Particles:
    """About `count` particles, each at the centroid of the dense points that are nearest to it and with their volume.

    The clusters are those of k-means within each part, from a bisection of its points: parts keep their volume and mass exactly,
    and equal input gives equal particles. Behind a clamp, ghosts mirror the root by half a grid cell. Sorted in grid order.
    """
    parts = np.unique(dense.part)
    size = np.array([dense.volume[dense.part == p].sum() for p in parts])
    counts = np.maximum(np.rint(count * size / size.sum()).astype(int), 1)
    found = [_reduced(dense, p, n) for p, n in zip(parts, counts, strict=True)]
    x, volume = (np.concatenate([f[i] for f in found]) for i in (0, 1))
    part = np.repeat(parts, [len(f[1]) for f in found])
    root = np.flatnonzero(x[:, 0] < GHOST_CELLS * dx) if body.clamped else np.zeros(0, int)
    index = np.r_[np.arange(len(x)), root]
    ghost = np.arange(len(index)) >= len(x)
    x = np.where(ghost[:, None], x[index] * [-1, 1, 1], x[index])
    order = grid_order(x, dx)
    index, part = index[order], part[index][order]
    return Particles(x[order], volume[index], part, body.density[part - 1], body.poisson[part - 1], ghost[order])


def _reduced(dense: DensePoints, part: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Centroids (K, 3) and volumes (K,) of at most `count` clusters of one part."""
    own = np.flatnonzero(dense.part == part)
    x, volume = dense.x[own], dense.volume[own]
    cluster = k_means(x, min(count, len(x)))
    total = np.bincount(cluster, volume)
    return _sums(cluster, x * volume[:, None]) / total[:, None], total


def k_means(x: np.ndarray, count: int) -> np.ndarray:
    """Cluster 0..K-1 of points (M, 3), shape (M,), K <= count: Lloyd's iteration from a bisection."""
    cluster = _bisected(x, count)
    for _ in range(LLOYD_STEPS):
        centre = _sums(cluster, x) / np.bincount(cluster)[:, None]
        cluster = np.unique(cKDTree(centre).query(x)[1], return_inverse=True)[1]
    return cluster


def _bisected(x: np.ndarray, count: int) -> np.ndarray:
    """Points (M, 3) cut across their longest side again and again into `count` <= M groups of equal size, shape (M,)."""
    cluster = np.zeros(len(x), int)
    pieces = [(np.arange(len(x)), 0, count)]
    while pieces:
        index, first, groups = pieces.pop()
        if groups == 1:
            cluster[index] = first
            continue
        side = int(np.ptp(x[index], axis=0).argmax())
        index, left = index[np.argsort(x[index, side], kind="stable")], groups // 2
        cut = len(index) * left // groups
        pieces += [(index[:cut], first, left), (index[cut:], first + left, groups - left)]
    return cluster


def _sums(cluster: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.bincount(cluster, column) for column in values.T], -1)
