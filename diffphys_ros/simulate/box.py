"""The part of the grid that a frame's particles can touch: transfers and grid sweeps run on it alone."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..types import Grid

FAR = 1e6  # cells: beyond any grid, within an integer


class Boxes:
    """Makes rows of integers (simulations, 8), a box for each: low i j k, size i j k, index of its first node in the nodal
    arrays, clamp index within it. All happens on the particles' device."""

    def __init__(self, grid: Grid, *, simulations: int, period_s: float, like: Tensor):
        """`like`: a tensor of the particles' scalar type and device."""
        self.grid, self.period_s = grid, period_s
        self.size = torch.tensor(grid.size, dtype=torch.int32, device=like.device)
        self.origin = like.new_tensor(grid.origin)
        self.order = torch.arange(simulations, dtype=torch.int32, device=like.device)[:, None]

    @property
    def whole_nodes(self) -> int:
        """Nodes of the grid."""
        return math.prod(self.grid.size)

    def whole(self) -> Tensor:
        """The whole grid for every simulation."""
        size = self.size.expand(len(self.order), 3)
        return self._rows(torch.zeros_like(size), size, self.whole_nodes)

    def around(self, data: Tensor, room: int) -> tuple[Tensor, Tensor]:
        """(boxes, nodes that the largest would need) for states (simulations, P, 24): space to move for a period at the
        present speeds, and a cell more. A box of more nodes than `room` is empty instead; the frame's flag then rises."""
        x, v = data[..., 0:3], data[..., 3:6]
        base = (torch.stack([x.amin(1), x.amax(1)]) - self.origin).div_(self.grid.dx).sub_(0.5).floor_()
        reach = (v.abs().amax(1) * (self.period_s / self.grid.dx)).ceil_().add_(1)
        ends = torch.stack([base[0] - reach, base[1] + reach + 2]).clamp_(-FAR, FAR)
        ends = torch.where(ends.isfinite(), ends, 0.0).to(torch.int32)
        low, high = ends[0].clamp_min(0), torch.minimum(ends[1], self.size - 1)
        holds = (high >= low + 2).all(1, keepdim=True)
        low, size = torch.where(holds, low, 0), torch.where(holds, high - low + 1, self.size)
        nodes = size.prod(1, keepdim=True)
        return self._rows(low, torch.where(nodes <= room, size, 0), room), nodes.max()

    def _rows(self, low: Tensor, size: Tensor, room: int) -> Tensor:
        clamp = (self.grid.clamp_index - low[:, :1]).clamp_min(-1)
        return torch.cat([low, size, self.order[: len(low)] * room, clamp], 1).to(torch.int32).contiguous()
