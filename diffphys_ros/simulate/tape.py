"""Consecutive substep states of one frame, with the program that fills them and runs back over them."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from .box import Box
from .program import Program, View
from .scratch import Scratch
from .state import WIDTH


class Tape:
    """States (length + 1, P, 24), and nodal velocities of each substep or of one (where `velocity_nodes` is 0)."""

    def __init__(self, scratch: Scratch, length: int, *, velocity_nodes: int, variant: tuple[Any, ...], program: type[Program]):
        self.velocity_nodes, self.grids = velocity_nodes, scratch.velocity_grids
        states = scratch.volume.new_zeros(length + 1, len(scratch.volume), WIDTH)
        velocity = scratch.volume.new_zeros(self.grids * max(length * velocity_nodes, scratch.nodes), 4)
        self.view = View(scratch, states, velocity, variant)
        self.program = program(self.view)

    def enter(self, box: Box, lattice: Any) -> None:
        """Work on this box of the grid from now on."""
        self.view.lattice, self.view.nodes = lattice, box.nodes

    @property
    def stride(self) -> int:
        """Distance of the kept velocity grids; 0 where the present box leaves no room to keep them."""
        return self.grids * self.view.nodes if self.view.nodes <= self.velocity_nodes else 0

    def run(self, data: Tensor, start: int, stop: int, *, keep: bool) -> Tensor:
        """State (P, 24) after substeps start .. stop - 1 from `data`; a view, which the next run overwrites. With `keep`
        every state stays, and the velocities where there is room: what `reverse` needs."""
        self.view.states[0].copy_(data)
        self.program.run(start, stop, keep=keep, stride=self.stride if keep else 0)
        return self.view.states[stop - start if keep else 0]

    def reverse(self, start: int, stop: int) -> None:
        """Take the adjoint in scratch from after the kept substep `stop` - 1 to before `start`, the first that was kept."""
        self.program.reverse(start, stop - start, stride=self.stride)
