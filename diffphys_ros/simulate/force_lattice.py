"""A force density on a lattice coarser than the grid, read trilinearly at the grid's nodes (before paper Eq. 9)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..types import Grid

MOST_NODES = 16  # along an axis, where no resolution is asked for


class ForceLattice:
    """Nodes spread evenly over the grid's extent, corner on corner; values are constant in time over a frame."""

    def __init__(self, grid: Grid, size: Sequence[int] | None = None, *, dtype: torch.dtype, device: torch.device | str):
        """`size`: nodes along each axis; None: those of the grid, but at most 16. Raises InputError."""
        size = tuple(min(n, MOST_NODES) for n in grid.size) if size is None else tuple(int(n) for n in size)
        if len(size) != 3 or any(not 2 <= n <= most for n, most in zip(size, grid.size, strict=False)):
            raise InputError(f"force_lattice is {size}; give three node counts from 2 to those of the grid, {grid.size}")
        self.size: tuple[int, int, int] = size  # type: ignore[assignment]
        self._along = [torch.as_tensor(_hats(n, fine), dtype=dtype, device=device) for n, fine in zip(size, grid.size, strict=True)]

    def on_nodes(self, values: Tensor) -> Tensor:
        """Force densities [N/m^3] on the grid's nodes, shape (..., nx, ny, nz, 3), from those on the lattice, (..., *size, 3)."""
        if values.shape[-4:] != (*self.size, 3):
            raise InputError(f"force has shape {tuple(values.shape)}; on this lattice it must end in {(*self.size, 3)}")
        for axis, hats in zip((-4, -3, -2), self._along, strict=True):
            values = torch.tensordot(values.movedim(axis, -1), hats, ([-1], [1])).movedim(-1, axis)
        return values


def _hats(coarse: int, fine: int) -> np.ndarray:
    """Value at `fine` even points of each hat function on `coarse` even points, shape (fine, coarse)."""
    place = np.linspace(0, coarse - 1, fine)
    return np.maximum(0.0, 1 - np.abs(place[:, None] - np.arange(coarse)))
