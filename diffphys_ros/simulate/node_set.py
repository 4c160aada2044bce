"""The nodes of a grid that particles can touch, and what acts on them (paper Eq. 9)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..types import Grid

STENCIL = np.stack(np.meshgrid(*3 * [np.arange(3)], indexing="ij"), -1).reshape(-1, 3)  # of a quadratic B-spline, from its base


@dataclass(frozen=True)
class NodeSet:
    """M of a grid's nodes; forces elsewhere would move nothing."""

    number: Tensor  # flat numbers in the order of the grid's size, (M,)
    size: tuple[int, int, int]  # of the grid

    @classmethod
    def of(cls, grid: Grid, number: np.ndarray, *, device: str | torch.device) -> NodeSet:
        """Those of flat numbers (M,)."""
        return cls(torch.as_tensor(np.asarray(number), dtype=torch.int64, device=device), grid.size)

    @classmethod
    def around(cls, grid: Grid, x: np.ndarray, *, reach_m: float, device: str | torch.device) -> NodeSet:
        """All that particles at x (P, 3) [m] touch wherever they go within reach_m of there, without those that the clamp holds."""
        touched, more = np.zeros(grid.size, bool), math.ceil(reach_m / grid.dx)
        base = np.unique(_base(grid, x)[0], axis=0)
        for step in STENCIL:
            touched[tuple((base + step).T)] = True
        for axis in range(3):  # a box of nodes to every side
            for _ in range(more):
                grown = touched.copy()
                wide, near, far = (np.moveaxis(a, axis, 0) for a in (grown, touched, touched))
                wide[1:] |= near[:-1]
                wide[:-1] |= far[1:]
                touched = grown
        touched[: grid.clamp_index + 1] = False
        return cls.of(grid, np.flatnonzero(touched), device=device)

    def places(self, grid: Grid) -> np.ndarray:
        """Where they lie [m], (M, 3)."""
        return grid.origin + grid.dx * np.stack(np.unravel_index(self.number.cpu().numpy(), grid.size), -1)

    def on_grid(self, values: Tensor) -> Tensor:
        """Values (M, 3) on the whole grid (nx, ny, nz, 3), zero elsewhere."""
        return values.new_zeros(math.prod(self.size), 3).index_copy(0, self.number, values).view(*self.size, 3)

    def silent(self, frames: int) -> Tensor:
        """No force in so many frames, in a shape that adds to `on_grid`."""
        return torch.zeros(frames, 1, 1, 1, 3, device=self.number.device)

    def at_particles(self, grid: Grid, x: np.ndarray, values: Tensor) -> Tensor:
        """What values on the nodes (T, M, 3) come to at particles x (P, 3) [m], (T, P, 3): with the particles' volumes it has the same sum."""
        base, offset = _base(grid, x)
        weights = np.stack([0.5 * (1.5 - offset) ** 2, 0.75 - (offset - 1) ** 2, 0.5 * (offset - 0.5) ** 2], 1)  # (P, 3 nodes, 3 axes)
        index = torch.full((math.prod(grid.size),), len(self.number), device=self.number.device)
        index[self.number] = torch.arange(len(self.number), device=self.number.device)
        padded, found = torch.nn.functional.pad(values, (0, 0, 0, 1)), values.new_zeros(len(values), len(x), 3)
        for step in STENCIL:
            share = torch.as_tensor(np.prod([weights[:, step[axis], axis] for axis in range(3)], 0)).to(values)
            place = torch.as_tensor(np.ravel_multi_index(tuple((base + step).T), grid.size), device=index.device)
            found = found + share[:, None] * padded.index_select(1, index[place])
        return found


def _base(grid: Grid, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First node of each particle's stencil (P, 3), and where the particle lies from there, in cells (P, 3)."""
    u = (x - grid.origin) / grid.dx
    base = np.floor(u - 0.5).astype(int)
    return base, u - base
