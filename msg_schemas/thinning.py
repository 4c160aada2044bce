"""Fewer particles that carry the same force: each kept one stands for a cluster of its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Recovery

_BITS = 10  # of one coordinate in the space-filling curve


@dataclass(frozen=True)
class Thinned:
    """What is published of a recovery: K particles out of N."""

    ids: np.ndarray  # indices into the recovery's particles, ascending, shape (K,)
    volume: np.ndarray  # of the cluster [m^3], shape (K,)
    force: np.ndarray  # volume-weighted mean over the cluster [N/m^3 of rest volume], 0 where clamped, shape (T, K, 3)


def thin(recovery: Recovery, max_points: int) -> Thinned:
    """At most `max_points` particles (at least one per part) with the recovery's sum of force * volume in every frame.

    Force on clamped particles moves nothing and is left out, so that the sum over the cloud is the net force.
    """
    free = recovery.force * ~recovery.clamped[:, None]
    if len(recovery.points) <= max_points:
        return Thinned(np.arange(len(recovery.points)), recovery.volume, free)
    cluster, kept = _clusters(recovery, max_points)
    volume = np.bincount(cluster, recovery.volume)
    force = np.stack([_sums(cluster, frame * recovery.volume[:, None]) for frame in free.astype(float)]) / volume[:, None]
    order = np.argsort(kept)
    return Thinned(kept[order], volume[order], force[:, order])


def _clusters(recovery: Recovery, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Cluster number of every particle, and the particle kept of every cluster: runs of a Z-order curve within a part."""
    order = np.lexsort((_z_order(recovery.points), recovery.part))
    parts = len(np.unique(recovery.part))
    run = np.arange(len(order)) * max(most - parts + 1, 1) // len(order)
    changes = (np.diff(run) != 0) | (np.diff(recovery.part[order]) != 0)
    number = np.concatenate([[0], np.cumsum(changes)])
    cluster = np.empty(len(order), int)
    cluster[order] = number
    first, size = np.searchsorted(number, np.arange(number[-1] + 1)), np.bincount(number)
    return cluster, order[first + size // 2]


def _z_order(points: np.ndarray) -> np.ndarray:
    """Position along a Z-order curve of points (N, 3): near points get near numbers."""
    low, extent = points.min(0), max(float(np.ptp(points, axis=0).max()), 1e-12)
    index = ((points - low) / extent * (2**_BITS - 1)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((index[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _sums(cluster: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.bincount(cluster, values[:, axis]) for axis in range(3)], -1)
