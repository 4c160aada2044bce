"""One frame forward, one frame backward: over the tape that was kept, or by replaying the frame from its first state."""

from __future__ import annotations

import math
import weakref
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from ..types import Grid
from .borders import Borders
from .box import Box
from .common import common
from .plan import NODE_VALUES, Plan
from .program import PROGRAMS
from .scratch import NO_FLAG, Inputs, Scratch
from .state import WIDTH
from .tape import Tape

EMPTY_SHARE = 1e-12  # nodes below this share of the mean particle mass are empty
BOX_ROOM = 1.5  # tapes keep velocities for boxes up to this times the one at rest


class Lease:
    """A tape lent to one frame's backward pass; returns by itself when the frame's graph is dropped."""

    def __init__(self, tape: Tape, free: list[Tape]):
        self.tape = tape
        self.give_back = weakref.finalize(self, free.append, tape)
        self.give_back.atexit = False


class Replay:
    """Everything that runs on the device, for one set of particles, grid, law, scalar type and number of substeps."""

    def __init__(
        self,
        x_rest: Tensor,
        volume: Tensor,
        mean_mass: float,
        grid: Grid,
        *,
        substeps: int,
        period_s: float,
        law: str,
        nodal: bool,
        borders: Borders,
        budget: float,
    ):
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # its banner and compile log are not ours to print
        wp.init()
        self.grid, self.period_s, self.substeps, self.mean_mass = grid, period_s, substeps, mean_mass
        self.scratch = Scratch(volume, math.prod(grid.size), nodal=nodal, borders=borders, substeps=substeps)
        self.variant = (law, self.scratch.real, nodal, bool(borders))
        self.boxed = volume.device.type == "cpu" and not nodal
        size = torch.finfo(volume.dtype).bits // 8
        rest = self._box(torch.cat([x_rest, torch.zeros_like(x_rest)], -1))
        self.box_room = min(self.scratch.nodes, int(BOX_ROOM * rest.nodes))
        self.state_bytes, self.velocity_bytes = size * WIDTH * len(volume), size * NODE_VALUES * self.scratch.velocity_grids * self.box_room
        self.plan = Plan.within(budget, substeps=substeps, state=self.state_bytes, velocity=self.velocity_bytes)
        self.once = self._tape(0, velocity_nodes=0)  # for runs that keep nothing
        self.free: list[Tape] = []
        self.lent = 0
        self._chunk_tape: Tape | None = None
        self._marks = volume.new_zeros(0)

    def forward(self, data: Tensor, values: tuple[Tensor, ...], *, keep: bool) -> tuple[Tensor, Box, Lease | None]:
        """State (P, 24) after one frame, the box it ran on, and its tape where one was to be kept and there was room."""
        lease = self._lend() if keep else None
        tape = lease.tape if lease else self.once
        box = self._box(data)
        after = self._attempt(tape, box, data, values, keep=lease is not None)
        if self.code != NO_FLAG and box != Box.whole(self.grid):
            box = Box.whole(self.grid)
            after = self._attempt(tape, box, data, values, keep=lease is not None)
        self._last = (tape, lease is not None)
        return after.clone(), box, lease

    def backward(self, data: Tensor, values: tuple[Tensor, ...], next_bar: Tensor, box: Box, lease: Lease | None) -> tuple[Tensor, Inputs]:
        """Adjoint of the state (P, 24) before the frame, and of the inputs (overwritten by the next call)."""
        self.scratch.begin_backward(values, next_bar)
        if lease and lease.give_back.alive:
            lease.tape.enter(box, self._lattice(box))
            lease.tape.reverse(0, self.substeps)
            lease.give_back()
        else:
            self._replay(data, box)
        self.scratch.inputs_bar.drag.copy_(self.scratch.drag_bar[: box.nodes].sum())
        return self.scratch.state_bar.clone(), self.scratch.inputs_bar

    def bytes(self) -> int:
        """Memory once gradients were asked for, tapes that stay between passes included [bytes]."""
        per_tape = self.state_bytes * (self.plan.chunk + 1) + self.plan.chunk * self.velocity_bytes * self.plan.keep_velocity
        grids = (13 + 4 * self.scratch.velocity_grids) * self.scratch.nodes * self.scratch.volume.element_size()
        return per_tape * (1 + self.plan.kept) + self.state_bytes * (self.plan.marks + 2) + grids

    def position(self, code: int) -> np.ndarray:
        """Position [m] (3,) of the particle that raised the flag `code`, after the substep that raised it."""
        substep, particle = divmod(code // 4, len(self.scratch.volume))
        tape, kept = self._last
        return tape.view.states[substep + 1 if kept else 0, particle, :3].cpu().numpy()

    def _attempt(self, tape: Tape, box: Box, data: Tensor, values: tuple[Tensor, ...], *, keep: bool) -> Tensor:
        self.scratch.begin_forward(values)
        tape.enter(box, self._lattice(box))
        after = tape.run(data, 0, self.substeps, keep=keep)
        self.code = int(self.scratch.flag.item())
        if self.code != NO_FLAG:
            tape.view.velocity.zero_()  # nodes without mass are not written: nothing that is not finite may stay there
        return after

    def _replay(self, data: Tensor, box: Box) -> None:
        tape = self._replay_tape()
        tape.enter(box, self._lattice(box))
        starts = range(0, self.substeps, self.plan.chunk)
        marks = [data]
        for index, start in enumerate(starts[:-1]):
            self._marks[index + 1].copy_(tape.run(marks[index], start, start + self.plan.chunk, keep=False))
            marks.append(self._marks[index + 1])
        for mark, start in zip(reversed(marks), reversed(starts), strict=True):
            stop = min(start + self.plan.chunk, self.substeps)
            tape.run(mark, start, stop, keep=True)
            tape.reverse(start, stop)

    def _replay_tape(self) -> Tape:
        if self._chunk_tape is None:
            self._chunk_tape = self._tape(self.plan.chunk, velocity_nodes=self.box_room * self.plan.keep_velocity)
            self._marks = self.scratch.volume.new_zeros(self.plan.marks, *self.once.view.states.shape[1:])
        return self._chunk_tape

    def _lend(self) -> Lease | None:
        if not self.free and self.lent < self.plan.kept:
            self.lent += 1
            self.free.append(self._tape(self.substeps, velocity_nodes=self.box_room))
        return Lease(self.free.pop(), self.free) if self.free else None

    def _tape(self, length: int, *, velocity_nodes: int) -> Tape:
        return Tape(
            self.scratch, length, velocity_nodes=velocity_nodes, variant=self.variant, program=PROGRAMS[self.scratch.volume.device.type]
        )

    def _box(self, data: Tensor) -> Box:
        if not self.boxed:
            return Box.whole(self.grid)
        x, v = (data[:, a:b].detach().numpy() for a, b in ((0, 3), (3, 6)))
        return Box.around(self.grid, x, v, period_s=self.period_s)

    def _lattice(self, box: Box) -> Any:
        t, dx = common(self.scratch.real), self.grid.dx
        lattice = t.Lattice()
        lattice.origin = t.vec3(*(self.grid.origin + dx * np.asarray(box.low)))
        lattice.dx, lattice.dt, lattice.affine = dx, self.period_s / self.substeps, 4.0 / dx**2
        lattice.empty_mass = EMPTY_SHARE * self.mean_mass
        lattice.nx, lattice.ny, lattice.nz = box.size
        lattice.clamp_index = max(self.grid.clamp_index - box.low[0], -1)
        return lattice
