"""Arrays that every substep of a simulator shares: torch owns them, Warp sees views."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ...types import Grid
from ..borders import Borders
from ..state import WIDTH
from ..substep.common import common
from ..substep.contact import contact
from ..substep.shared_inputs import world_of
from .box import COLUMNS, NO_FLAG, NOWHERE, whole

REAL = {torch.float32: wp.float32, torch.float64: wp.float64}
EMPTY_SHARE = 1e-12  # nodes below this share of the mean particle mass are empty
ALIGNED = 4  # scalars: fields of the inputs start where 4-vectors may


@dataclass
class Inputs:
    """What one frame depends on beside its state; also holds the adjoints of the same. B is the number of simulations."""

    constants: Tensor  # of the law: mu and lam [Pa] and two of its own, shape (B, P, 4)
    body: Tensor  # force density, gravity included [N/m^3 of rest volume], shape (B, P, 3)
    mass: Tensor  # [kg], shape (B, P)
    drag: Tensor  # share of velocity that mass damping leaves over a substep, shape (B,)
    node_force: Tensor  # force density on the nodes [N/m^3 of rest volume], shape (B, nodes, 3); no nodes where there is none
    friction: Tensor  # of each plane, shape (B, planes)
    motion: Tensor  # velocity of the nodes that the handle holds is motion (x, 1) [1/s, m/s], shape (B, substeps, 3, 4)
    handle_from_body: Tensor  # at each substep, shape (B, substeps, 3, 4); without gradient
    anchor: Tensor  # x [m] and F where particles had the weights that they keep, shape (B, P, 12); no particles where they keep none

    @classmethod
    def zeros_like(cls, volume: Tensor, batch: int, *, loaded_nodes: int, planes: int, substeps: int, anchored: bool) -> Inputs:
        """All zero, for particles of the given volumes (P,)."""
        count, path = len(volume), (substeps, 3, 4)
        shapes = [(batch, *s) for s in ((count, 4), (count, 3), (count,), (), (loaded_nodes, 3), (planes,), path, path, (count * anchored, 12))]
        sizes = [math.prod(shape) for shape in shapes]
        parts = volume.new_zeros(sum(_aligned(n) for n in sizes)).split([_aligned(n) for n in sizes])
        return cls(*(part[:n].view(shape) for part, n, shape in zip(parts, sizes, shapes, strict=True)))

    def tensors(self) -> tuple[Tensor, ...]:
        """The fields in order."""
        of_material = self.constants, self.body, self.mass, self.drag
        return *of_material, self.node_force, self.friction, self.motion, self.handle_from_body, self.anchor

    def zero_(self) -> None:
        """All zero, in one go."""
        flat = self.constants
        flat.as_strided((flat.untyped_storage().nbytes() // flat.element_size(),), (1,), 0).zero_()


def _aligned(scalars: int) -> int:
    return -(-scalars // ALIGNED) * ALIGNED


class Scratch:
    """Inputs, adjoints and flags of all simulations, and nodal arrays that grow with the boxes."""

    def __init__(
        self, volume: Tensor, grid: Grid, *, batch: int, mean_mass: float, frame_s: float, nodal: bool, borders: Borders, substeps: int, anchored: bool
    ):
        zeros, nodes, dt = volume.new_zeros, math.prod(grid.size), frame_s / substeps
        self.frame_s = frame_s
        sizes: dict[str, Any] = {"loaded_nodes": nodes * nodal, "planes": len(borders.planes), "substeps": substeps * bool(borders), "anchored": anchored}
        self.volume, self.batch, self.real, self.planes = volume, batch, REAL[volume.dtype], max(1, len(borders.planes)) * bool(borders)
        self.pitch = 2 + self.planes if borders else 1
        self.every_volume = volume.repeat(batch)
        self.inputs, self.inputs_bar = (Inputs.zeros_like(volume, batch, **sizes) for _ in range(2))
        self.state_bar = zeros(batch, len(volume), WIDTH)
        self.flags = torch.full((batch + 1,), NO_FLAG, dtype=torch.int64, device=volume.device)  # and what box.settle says
        self.boxes = torch.zeros(batch, COLUMNS, dtype=torch.int32, device=volume.device)
        self.extents = torch.tensor(NOWHERE, dtype=torch.int32, device=volume.device).repeat(batch, 1)
        self.whole = whole(grid, batch).to(volume.device)
        self.taken: list[tuple[Tensor | None, int]] = [(None, 0)] * len(self.inputs.tensors())
        self.start = torch.zeros(1, dtype=torch.int32, device=volume.device)
        self.world, self.world_bar = (self._world(grid, borders, i, mean_mass=mean_mass, dt=dt) for i in (self.inputs, self.inputs_bar))
        self.bars = self.states(self.state_bar[None])
        self.version, self._start = 0, 0
        self._grids = zeros(0, 0)
        self.reserve(1)

    def reserve(self, nodes: int) -> None:
        """Have room for so many nodes of each simulation; recorded launches of an older version are void after it grew."""
        wanted = self.batch * nodes
        counts = [1, 1, 1, self.pitch, self.planes, self.planes]  # 4-vectors per node
        if wanted * sum(counts) <= self._grids.numel() // 4:
            return
        self._grids = self.volume.new_zeros(wanted * sum(counts), 4)
        parts = self._grids.split([wanted * count for count in counts])
        self.momentum, self.velocity_bar, self.momentum_bar, self.velocity, self.near, near_bar = parts
        if self.planes:
            self.world.borders.near, self.world_bar.borders.near = self.see(self.near, 4), self.see(near_bar, 4)
        self.drag_bar = self.volume.new_zeros(wanted)
        self.world_bar.drag = self.see(self.drag_bar)
        self.version += 1

    def begin_forward(self, values: tuple[Tensor, ...], boxes: Tensor | None) -> None:
        """Take a frame's inputs, and its boxes where they are known; forget what an interrupted or diverged run left behind."""
        self._take(values)
        self.momentum.zero_()
        self.near.zero_()
        if boxes is not None:
            self.boxes.copy_(boxes)
            self.flags.fill_(NO_FLAG)

    def begin_backward(self, values: tuple[Tensor, ...], boxes: Tensor | None, next_bar: Tensor) -> None:
        """As begin_forward, for the adjoint of the states after the frame (B, P, 24); boxes that are there already stay."""
        self._take(values)
        if boxes is not None:
            self.boxes.copy_(boxes)
        self.state_bar.copy_(next_bar)
        self._grids[: 2 * len(self.momentum)].zero_()  # momentum and velocity_bar; nothing reads the rest before writing it
        for grid in (self.near, self.drag_bar):
            grid.zero_()
        self.inputs_bar.zero_()

    def begin_at(self, substep: int) -> None:
        """The next run or reversal starts at this substep of the frame."""
        if substep != self._start:
            self._start = substep
            self.start.fill_(substep)

    def _take(self, values: tuple[Tensor, ...]) -> None:
        """Copy the inputs that differ from the last ones. Those that torch did not compute are copied anyhow: their
        owner may write to their memory."""
        for index, (mine, value) in enumerate(zip(self.inputs.tensors(), values, strict=True)):
            computed = value.grad_fn is not None
            if value.numel() and not (computed and self._is(index, value)):
                mine.copy_(value)
                self.taken[index] = value.detach() if computed else None, value._version if computed else 0

    def _is(self, index: int, value: Tensor) -> bool:
        """Whether a value is what was last taken; memory that is held cannot have become another tensor's."""
        last, version = self.taken[index]
        same = last is not None and last.data_ptr() == value.data_ptr() and last.stride() == value.stride()
        return same and value._version == version

    def end_backward(self, room: int) -> Inputs:
        """Adjoints of the frame's inputs, which ran on boxes `room` nodes apart."""
        self.inputs_bar.drag.copy_(self.drag_bar[: self.batch * room].view(self.batch, room).sum(1))
        return self.inputs_bar

    def bytes(self) -> int:
        """Memory of the nodal arrays [bytes]."""
        return (self._grids.numel() + self.drag_bar.numel()) * self.volume.element_size()

    def states(self, data: Tensor) -> Any:
        """Warp's view of states (slots, B, P, 24)."""
        return wp.from_torch(data.view(len(data), -1, 4), dtype=common(self.real).vec4)

    def see(self, tensor: Tensor, length: int = 0) -> Any:
        """Warp view of all scalars of a tensor, or of its vectors of a length."""
        if length:
            return wp.from_torch(tensor.view(-1, length), dtype=wp.types.vector(length, self.real))
        return wp.from_torch(tensor.view(-1))

    def _world(self, grid: Grid, borders: Borders, i: Inputs, *, mean_mass: float, dt: float) -> Any:
        w = world_of(self.real, bool(borders)).World()
        w.grid.origin, w.grid.dx, w.grid.dt, w.grid.affine = common(self.real).vec3(*grid.origin), grid.dx, dt, 4.0 / grid.dx**2
        w.grid.nx, w.grid.ny, w.grid.nz = grid.size
        w.grid.clamp_index, w.grid.empty_mass = grid.clamp_index, EMPTY_SHARE * mean_mass
        w.boxes, w.particles, w.start = wp.from_torch(self.boxes), len(self.volume), self.see(self.start)
        w.materials, w.borders, w.drag = self._materials(i), self._borders(borders, i), self.see(i.drag)
        return w

    def _materials(self, i: Inputs) -> Any:
        m, see = common(self.real).Materials(), self.see
        m.constants, m.body, m.mass = see(i.constants, 4), see(i.body, 3), see(i.mass)
        m.volume, m.node_force = see(self.every_volume), see(i.node_force, 3)
        m.anchor = see(i.anchor, 4)
        return m

    def _borders(self, borders: Borders, i: Inputs) -> Any:
        c, vec3, see = contact(self.real, bool(borders)), common(self.real).vec3, self.see
        b = c.Borders()
        if borders:
            planes, new = borders.planes, self.volume.new_tensor
            b.normal = see(new(np.array([p.unit_normal for p in planes]).reshape(-1, 3)), 3)
            b.offset, b.friction = see(new([p.offset_m for p in planes])), wp.from_torch(i.friction)
            b.anchored = int(i.anchor.numel() > 0)
            b.kind = wp.array([p.kind_index for p in planes], dtype=int, device=b.offset.device)
            b.motion, b.handle_from_body = (wp.from_torch(a, dtype=c.mat34) for a in (i.motion, i.handle_from_body))
            b.low, b.high = (vec3(*bound) for bound in borders.box)
        return b
