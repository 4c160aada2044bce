"""Arrays that every substep of a simulator shares: torch owns them, Warp sees views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from .borders import Borders
from .common import common
from .contact import contact
from .state import WIDTH

REAL = {torch.float32: wp.float32, torch.float64: wp.float64}
NO_FLAG = 2**62


@dataclass
class Inputs:
    """What one frame depends on beside its state; also holds the adjoints of the same."""

    constants: Tensor  # of the law: mu and lam [Pa] and two of its own, shape (P, 4)
    body: Tensor  # force density, gravity included [N/m^3 of rest volume], shape (P, 3)
    mass: Tensor  # [kg], shape (P,)
    drag: Tensor  # share of velocity that mass damping leaves over a substep, shape (1,)
    node_force: Tensor  # force density on the nodes [N/m^3 of rest volume], shape (nodes, 3); (1, 3) where there is none
    friction: Tensor  # of each plane, shape (planes,)
    motion: Tensor  # velocity of the nodes that the handle holds is motion (x, 1) [1/s, m/s], shape (substeps, 3, 4)
    handle_from_body: Tensor  # at each substep, shape (substeps, 3, 4); without gradient

    @classmethod
    def zeros_like(cls, volume: Tensor, *, loaded_nodes: int, planes: int, substeps: int) -> Inputs:
        """All zero, for particles of the given volumes (P,)."""
        count, path = len(volume), (substeps, 3, 4)
        shapes = (count, 4), (count, 3), (count,), (1,), (max(loaded_nodes, 1), 3), (planes,), path, path
        return cls(*(volume.new_zeros(shape) for shape in shapes))

    def tensors(self) -> tuple[Tensor, ...]:
        """The fields in order."""
        return self.constants, self.body, self.mass, self.drag, self.node_force, self.friction, self.motion, self.handle_from_body

    def copy_(self, values: tuple[Tensor, ...]) -> None:
        """Overwrite the fields in place."""
        for mine, value in zip(self.tensors(), values, strict=True):
            mine.copy_(value)


class Scratch:
    """Grids, inputs, adjoints and flag, sized for the whole grid."""

    def __init__(self, volume: Tensor, nodes: int, *, nodal: bool, borders: Borders, substeps: int):
        zeros = volume.new_zeros
        sizes = {"loaded_nodes": nodes * nodal, "planes": len(borders.planes), "substeps": substeps * bool(borders)}
        self.volume, self.nodes, self.real = volume, nodes, REAL[volume.dtype]
        self.inputs = Inputs.zeros_like(volume, **sizes)
        self.momentum = zeros(nodes, 4)
        self.flag = torch.full((1,), NO_FLAG, dtype=torch.int64, device=volume.device)
        self.inputs_bar = Inputs.zeros_like(volume, **sizes)
        self.state_bar = zeros(len(volume), WIDTH)
        self.velocity_bar, self.momentum_bar = zeros(nodes, 4), zeros(nodes, 4)
        self.drag_bar = zeros(nodes)
        self.velocity_grids = 1 + bool(borders)  # what nodes meet at borders takes their velocity before, too
        self.momentum_view, self.drag = self.see(self.momentum, 4), self.see(self.inputs.drag)
        self.materials, self.materials_bar = self._materials(self.inputs), self._materials(self.inputs_bar)
        self.borders, self.borders_bar = (self._borders(borders, i) for i in (self.inputs, self.inputs_bar))
        self.bars = self.states(self.state_bar[None])

    def begin_forward(self, values: tuple[Tensor, ...]) -> None:
        """Take a frame's inputs; forget what an interrupted or diverged run left behind."""
        self.inputs.copy_(values)
        self.flag.fill_(NO_FLAG)
        self.momentum.zero_()

    def begin_backward(self, values: tuple[Tensor, ...], next_bar: Tensor) -> None:
        """As begin_forward, for the adjoint of the state after the frame (P, 24)."""
        self.begin_forward(values)
        self.state_bar.copy_(next_bar)
        for bar in (self.velocity_bar, self.momentum_bar, self.drag_bar, *self.inputs_bar.tensors()):
            bar.zero_()

    def states(self, data: Tensor) -> Any:
        """Warp's view of states (slots, P, 24)."""
        t = common(self.real)
        fields = t.States()
        fields.x, fields.v = (wp.from_torch(data[..., a:b], dtype=t.vec3) for a, b in ((0, 3), (3, 6)))
        fields.C, fields.F = (wp.from_torch(data[..., a:b].unflatten(-1, (3, 3)), dtype=t.mat33) for a, b in ((6, 15), (15, 24)))
        return fields

    def see(self, tensor: Tensor, length: int = 0) -> Any:
        """Warp view of a tensor of scalars, or of vectors of a length."""
        if tensor.dtype == torch.int64:
            return wp.from_torch(tensor, dtype=wp.int64)
        return wp.from_torch(tensor, dtype=wp.types.vector(length, self.real) if length else self.real)

    def _materials(self, i: Inputs) -> Any:
        m, see = common(self.real).Materials(), self.see
        m.constants, m.body, m.mass = see(i.constants, 4), see(i.body, 3), see(i.mass)
        m.volume, m.node_force = see(self.volume), see(i.node_force, 3)
        return m

    def _borders(self, borders: Borders, i: Inputs) -> Any:
        c, vec3, see = contact(self.real, bool(borders)), common(self.real).vec3, self.see
        b = c.Borders()
        if borders:
            planes, new = borders.planes, self.volume.new_tensor
            b.normal = see(new(np.array([p.unit_normal for p in planes]).reshape(-1, 3)), 3)
            b.offset, b.friction = see(new([p.offset_m for p in planes])), see(i.friction)
            b.kind = wp.array([p.kind_index for p in planes], dtype=int, device=b.offset.device)
            b.motion, b.handle_from_body = (wp.from_torch(a, dtype=c.mat34) for a in (i.motion, i.handle_from_body))
            b.low, b.high = (vec3(*bound) for bound in borders.box)
        return b
