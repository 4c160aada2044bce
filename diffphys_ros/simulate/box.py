"""The part of the grid that a frame's particles can touch: transfers and grid sweeps run on it alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..types import Grid


@dataclass(frozen=True)
class Box:
    """Nodes low .. low + size - 1 of a grid along each axis."""

    low: tuple[int, int, int]
    size: tuple[int, int, int]

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return math.prod(self.size)

    @classmethod
    def whole(cls, grid: Grid) -> Box:
        """The grid itself."""
        return cls((0, 0, 0), grid.size)

    @classmethod
    def around(cls, grid: Grid, x: np.ndarray, v: np.ndarray, *, period_s: float) -> Box:
        """Room for particles at x (P, 3) [m] to move for a period at their present speeds v [m/s], and a cell more."""
        base = np.floor((np.stack([x.min(0), x.max(0)]) - grid.origin) / grid.dx - 0.5)
        reach = np.ceil(np.abs(v).max(0) * period_s / grid.dx) + 1
        if not np.all(np.isfinite(base) & np.isfinite(reach)):
            return cls.whole(grid)
        low = np.clip(base[0] - reach, 0, None).astype(int)
        high = np.minimum(base[1] + 2 + reach, np.asarray(grid.size) - 1).astype(int)
        if np.any(high < low + 2):
            return cls.whole(grid)
        return cls(tuple(low.tolist()), tuple((high - low + 1).tolist()))
