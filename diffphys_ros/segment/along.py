"""Distances that do not leave the object."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

STEPS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, np.sqrt(2.0)), (1, -1, np.sqrt(2.0)))  # to half of a pixel's neighbours: rows, columns, length [px]


def along(mask: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """Length of the shortest way inside the mask (H, W) from its pixel nearest to `pixel` (u, v), (H, W) [px]; inf where none leads."""
    v, u = np.nonzero(mask)
    number = np.full(mask.shape, -1)
    number[v, u] = np.arange(len(v))
    rows, columns, lengths = [], [], []
    for down, right, length in STEPS:
        to_v, to_u = v + down, u + right
        inside = (to_v < mask.shape[0]) & (to_u >= 0) & (to_u < mask.shape[1])
        to = np.full(len(v), -1)
        to[inside] = number[to_v[inside], to_u[inside]]
        rows.append(np.flatnonzero(to >= 0))
        columns.append(to[to >= 0])
        lengths.append(np.full(len(rows[-1]), length))
    graph = coo_array((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(len(v), len(v))).tocsr()
    away = np.full(mask.shape, np.inf)
    away[v, u] = dijkstra(graph, directed=False, indices=int(np.hypot(u - pixel[0], v - pixel[1]).argmin()))
    return away
