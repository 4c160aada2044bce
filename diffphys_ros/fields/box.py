"""The region over which a field carries features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

MARGIN = 0.05  # of the largest extent, on every side, so that no particle lies on the border


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the body frame."""

    low: np.ndarray  # [m], (3,)
    high: np.ndarray  # [m], (3,)

    @classmethod
    def around(cls, points: np.ndarray) -> Box:
        """The box of points (P, 3) [m] with a margin."""
        low, high = points.min(0), points.max(0)
        margin = MARGIN * float((high - low).max())
        return cls(low - margin, high + margin)

    @property
    def size(self) -> np.ndarray:
        """Extents [m], (3,)."""
        return self.high - self.low

    def unit(self, x: Tensor) -> Tensor:
        """Points (..., 3) [m] as coordinates in -1 .. 1."""
        low, size = (torch.as_tensor(a, dtype=x.dtype, device=x.device) for a in (self.low, self.size))
        return 2 * (x - low) / size - 1

    def cells(self, along_longest: int) -> tuple[int, int, int]:
        """Numbers of lattice nodes along x, y, z of about cubic cells, at least two each."""
        count = np.maximum(np.rint(self.size / self.size.max() * along_longest).astype(int), 2)
        return int(count[0]), int(count[1]), int(count[2])
