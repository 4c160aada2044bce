"""Ways inside a raster that do not leave a region. numpy and scipy only."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))  # to half of a raster cell's neighbours


def way_lengths(inside: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Length [cells] of the shortest way inside a region (nx, ny) from the nearest of its cells in `start`, bool (nx, ny), to every cell, float (nx, ny);
    inf outside and where no way leads."""
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(inside.sum())
    rows, columns, lengths = [], [], []
    for i, j in STEPS:
        a, b = shifted_pairs(number, i, j)
        both = (a >= 0) & (b >= 0)
        rows.append(a[both])
        columns.append(b[both])
        lengths.append(np.full(int(both.sum()), np.hypot(i, j)))
    graph = coo_array((np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(inside.sum(),) * 2).tocsr()
    length = np.full(inside.shape, np.inf)
    length[inside] = dijkstra(graph, directed=False, indices=number[start & inside], min_only=True)
    return length


def shifted_pairs(values: np.ndarray, i: int, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Values of every raster cell and of the one (i, j) further on, where there is one, flat; i is 0 or more."""
    nx, ny = values.shape
    low, high = max(0, -j), ny - max(0, j)
    return values[: nx - i, low:high].ravel(), values[i:, low + j : high + j].ravel()
