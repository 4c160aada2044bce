"""Runs the kernels: one frame forward, one frame backward by replay. Owns the scratch memory of one simulator.

Memory: torch owns every array, Warp sees views of it. A frame's substep states lie in `slots`; where K + 1 of them do
not fit the budget, the backward pass keeps every c-th state (c = ceil(sqrt(K))) in `marks` and replays c substeps at a
time. One momentum and one velocity grid, and their adjoints, serve every substep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ..types import Grid
from .adjoint import adjoint
from .kernels import common, forward
from .state import WIDTH

NO_FLAG = 2**62
REAL = {torch.float32: wp.float32, torch.float64: wp.float64}
EMPTY_SHARE = 1e-12  # nodes below this share of the mean particle mass are empty


@dataclass
class Inputs:
    """What one frame depends on beside its state. Also holds the adjoints of the same."""

    mu: Tensor  # [Pa], shape (P,)
    lam: Tensor  # [Pa], shape (P,)
    body: Tensor  # force density, gravity included [N/m^3 of rest volume], shape (P, 3)
    mass: Tensor  # [kg], shape (P,)
    keep: Tensor  # share of velocity kept over a substep, shape (1,)
    node_force: Tensor  # force density on the nodes [N/m^3 of rest volume], shape (nodes, 3); (1, 3) where there is none

    @classmethod
    def zeros_like(cls, volume: Tensor, loaded_nodes: int) -> Inputs:
        """All zero, for particles of the given volumes (P,)."""
        count = len(volume)
        return cls(*(volume.new_zeros(s) for s in ((count,), (count,), (count, 3), (count,), (1,), (max(loaded_nodes, 1), 3))))

    def tensors(self) -> tuple[Tensor, ...]:
        """The fields in order."""
        return self.mu, self.lam, self.body, self.mass, self.keep, self.node_force

    def copy_(self, values: tuple[Tensor, ...]) -> None:
        """Overwrite the fields in place."""
        for mine, value in zip(self.tensors(), values, strict=True):
            mine.copy_(value)


@dataclass(frozen=True)
class Plan:
    """How many states of a frame are kept: `slots` consecutive ones, and `marks` chunk starts."""

    substeps: int
    chunk: int  # substeps replayed at a time

    @classmethod
    def within(cls, budget_bytes: float, *, substeps: int, state_bytes: int) -> Plan:
        """All states of a frame where they fit the budget, else chunks of ceil(sqrt(substeps))."""
        fits = (substeps + 1) * state_bytes <= budget_bytes
        return cls(substeps, substeps if fits else math.ceil(math.sqrt(substeps)))

    @property
    def slots(self) -> int:
        """Consecutive states kept."""
        return self.chunk + 1

    @property
    def marks(self) -> int:
        """Chunk starts kept; none where one chunk is the whole frame."""
        chunks = math.ceil(self.substeps / self.chunk)
        return chunks if chunks > 1 else 0

    @property
    def states(self) -> int:
        """States kept in all: about 2 sqrt(substeps) where the budget is small."""
        return self.slots + self.marks


class Replay:
    """Scratch memory and recorded launches for one set of particles, grid, law, scalar type and number of substeps."""

    def __init__(self, volume: Tensor, mass_scale: float, grid: Grid, plan: Plan, *, period_s: float, law: str, nodal: bool):
        wp.init()
        self.plan, self.device, self.dtype = plan, volume.device, volume.dtype
        self.real, self.particles = REAL[volume.dtype], len(volume)
        self.variant = (law, self.real, nodal)
        self.lattice = self._lattice(grid, period_s / plan.substeps, mass_scale)
        self.nodes = math.prod(grid.size)
        self.volume = volume
        self.inputs = Inputs.zeros_like(volume, self.nodes * nodal)
        self.slots = volume.new_zeros(1, self.particles, WIDTH)  # grows to plan.slots with the first backward pass
        self.momentum, self.velocity = (volume.new_zeros(self.nodes, 4) for _ in range(2))
        self.flag = torch.full((1,), NO_FLAG, dtype=torch.int64, device=self.device)
        self._forward: list[wp.Launch] | None = None
        self._adjoint: list[wp.Launch] | None = None

    def _lattice(self, grid: Grid, dt: float, mass_scale: float) -> Any:
        lattice = common(self.real).Lattice()
        lattice.origin = common(self.real).vec3(*grid.origin)
        lattice.dx, lattice.dt, lattice.affine = grid.dx, dt, 4.0 / grid.dx**2
        lattice.empty_mass = EMPTY_SHARE * mass_scale
        lattice.nx, lattice.ny, lattice.nz = grid.size
        lattice.clamp_index = grid.clamp_index
        return lattice

    def bytes(self) -> int:
        """Scratch memory [bytes] once gradients were asked for."""
        size = torch.finfo(self.dtype).bits // 8
        return size * (WIDTH * self.particles * (self.plan.states + 1) + 17 * self.nodes)

    def forward(self, data: Tensor, values: tuple[Tensor, ...]) -> Tensor:
        """State (P, 24) after one frame."""
        self._clear(self.momentum, self.velocity)
        self.inputs.copy_(values)
        self.slots[0].copy_(data)
        self.flag.fill_(NO_FLAG)
        self._run(0, self.plan.substeps, keep=False)
        return self.slots[0].clone()

    def backward(self, data: Tensor, values: tuple[Tensor, ...], next_bar: Tensor) -> tuple[Tensor, Inputs]:
        """Adjoint of the state (P, 24) before the frame, and of the inputs."""
        self._make_room()
        self.inputs.copy_(values)
        self.state_bar.copy_(next_bar)
        self._clear(self.momentum, self.velocity, self.velocity_bar, self.keep_bar, *self.inputs_bar.tensors())
        self.slots[0].copy_(data)
        starts = range(0, self.plan.substeps, self.plan.chunk)
        self._place_marks(starts)
        for index, start in reversed(list(enumerate(starts))):
            if self.plan.marks:
                self.slots[0].copy_(self.marks[index])
            self._reverse(start, min(start + self.plan.chunk, self.plan.substeps))
        self.inputs_bar.keep.copy_(self.keep_bar.sum())
        return self.state_bar.clone(), self.inputs_bar

    @staticmethod
    def _clear(*scratch: Tensor) -> None:
        """Forget what an interrupted or diverged run left behind."""
        for tensor in scratch:
            tensor.zero_()

    def _place_marks(self, starts: range) -> None:
        for index, start in enumerate(starts):
            if self.plan.marks:
                self.marks[index].copy_(self.slots[0])
                if index + 1 < self.plan.marks:
                    self._run(start, start + self.plan.chunk, keep=False)

    def _reverse(self, start: int, stop: int) -> None:
        self._run(start, stop, keep=True)
        for slot in range(stop - start - 1, -1, -1):
            self._reverse_substep(slot)

    def _run(self, start: int, stop: int, *, keep: bool) -> None:
        p2g, grid, g2p = self._forward or self._record_forward()
        for n in range(start, stop):
            slot, after = (n - start, n - start + 1) if keep else (0, 0)
            p2g.set_param_at_index(1, slot)
            g2p.set_param_at_index(1, slot)
            g2p.set_param_at_index(2, after)
            g2p.set_param_at_index(3, n)
            p2g.launch()
            grid.launch()
            g2p.launch()

    def _reverse_substep(self, slot: int) -> None:
        p2g, grid, _ = self._forward or self._record_forward()
        g2p_adjoint, grid_adjoint, p2g_adjoint = self._adjoint or self._record_adjoint()
        p2g.set_param_at_index(1, slot)
        g2p_adjoint.set_param_at_index(1, slot)
        g2p_adjoint.set_param_at_index(2, slot + 1)
        p2g_adjoint.set_param_at_index(1, slot)
        for command in (p2g, grid, g2p_adjoint, grid_adjoint, p2g_adjoint):
            command.launch()

    def _make_room(self) -> None:
        if self._adjoint is not None:
            return
        zeros = self.volume.new_zeros
        self.slots = zeros(self.plan.slots, self.particles, WIDTH)
        self.marks = zeros(self.plan.marks, self.particles, WIDTH)
        self.state_bar = zeros(self.particles, WIDTH)
        self.inputs_bar = Inputs.zeros_like(self.volume, self.nodes * self.variant[2])
        self.velocity_bar, self.momentum_bar = (zeros(self.nodes, 4) for _ in range(2))
        self.keep_bar = zeros(self.nodes)
        self._forward = None

    def _record_forward(self) -> list[wp.Launch]:
        k, see, state = forward(*self.variant), self._see, self._fields(self.slots)
        i = self.inputs
        material = [see(i.mu), see(i.lam), see(i.body, 3), see(self.volume), see(i.mass), see(i.node_force, 3)]
        momentum, velocity = see(self.momentum, 4), see(self.velocity, 4)
        self._forward = [
            self._command(k.p2g, self.particles, [self.lattice, 0, *state, *material, momentum]),
            self._command(k.grid, self.nodes, [self.lattice, see(i.keep), momentum, velocity]),
            self._command(k.g2p, self.particles, [self.lattice, 0, 0, 0, velocity, *state, see(self.flag)]),
        ]
        return self._forward

    def _record_adjoint(self) -> list[wp.Launch]:
        k, see, state = adjoint(*self.variant), self._see, self._fields(self.slots)
        i, b = self.inputs, self.inputs_bar
        x_bar, v_bar, C_bar, F_bar = self._fields(self.state_bar)
        material = [see(i.mu), see(i.lam), see(i.body, 3), see(self.volume), see(i.mass), see(i.node_force, 3)]
        material_bar = [see(b.mu), see(b.lam), see(b.body, 3), see(b.mass), see(b.node_force, 3)]
        velocity, velocity_bar, momentum_bar = see(self.velocity, 4), see(self.velocity_bar, 4), see(self.momentum_bar, 4)
        to_grid = [self.lattice, 0, 0, *state, velocity, v_bar, C_bar, x_bar, F_bar, velocity_bar]
        at_grid = [see(i.keep), velocity, velocity_bar, momentum_bar, see(self.keep_bar)]
        from_grid = [self.lattice, 0, *state, *material, momentum_bar, x_bar, v_bar, C_bar, F_bar, *material_bar]
        self._adjoint = [
            self._command(k.g2p_adjoint, self.particles, to_grid),
            self._command(k.grid_adjoint, self.nodes, at_grid),
            self._command(k.p2g_adjoint, self.particles, from_grid),
        ]
        return self._adjoint

    def _command(self, kernel: Any, dim: int, inputs: list) -> wp.Launch:
        return wp.launch(kernel, dim=dim, inputs=inputs, device=str(self.device), record_cmd=True)

    def _see(self, tensor: Tensor, length: int = 0) -> Any:
        if tensor.dtype == torch.int64:
            return wp.from_torch(tensor, dtype=wp.int64)
        return wp.from_torch(tensor, dtype=wp.types.vector(length, self.real) if length else self.real)

    def _fields(self, data: Tensor) -> list[Any]:
        t = common(self.real)
        vectors = [wp.from_torch(data[..., a:b], dtype=t.vec3) for a, b in ((0, 3), (3, 6))]
        matrices = [wp.from_torch(data[..., a:b].unflatten(-1, (3, 3)), dtype=t.mat33) for a, b in ((6, 15), (15, 24))]
        return vectors + matrices

    def raised(self) -> int | None:
        """Flag code of the last frame, None where all went well (waits for the device)."""
        code = int(self.flag.item())
        return None if code == NO_FLAG else code

    def position(self, particle: int) -> np.ndarray:
        """Last position of a particle [m], shape (3,)."""
        return self.slots[0, particle, :3].cpu().numpy()
