"""Consecutive substep states of one frame, with the program that fills them and runs back over them."""

from __future__ import annotations

from torch import Tensor

from ..state import WIDTH
from ..substep.shared_inputs import Variant
from .buffers import Scratch
from .launches import Program, TapeArrays


class Tape:
    """States (length + 1, B, P, 24), and nodal velocities of each substep where `room` says for how many nodes a simulation."""

    def __init__(self, scratch: Scratch, length: int, *, room: int, variant: Variant, program: type[Program]):
        self.scratch, self.room = scratch, room
        zeros, batch = scratch.volume.new_zeros, scratch.batch
        self.states = zeros(length + 1, batch, len(scratch.volume), WIDTH)
        self.velocity = zeros(length * batch * room * variant.pitch, 4)
        self.program = program(TapeArrays(scratch, self.states, self.velocity, variant))

    def run(self, data: Tensor, start: int, stop: int, *, keep: bool, room: int, enclose: bool = False) -> Tensor:
        """States (B, P, 24) after substeps start .. stop - 1 from `data`; a view, which the next run overwrites. With `keep`
        every state stays, and the velocities where boxes lie `room` nodes apart as here: what `reverse` needs. With
        `enclose` the boxes are first made."""
        self.states[0].copy_(data)
        self.scratch.begin_at(start)
        self.program.run(stop - start, keep=keep, stride=self._stride(room) if keep else 0, room=room, enclose=enclose)
        return self.states[stop - start if keep else (stop - start) % 2]

    def reverse(self, start: int, stop: int, *, room: int) -> None:
        """Take the adjoint in scratch from after the kept substep `stop` - 1 to before `start`, the first that was kept."""
        self.scratch.begin_at(start)
        self.program.reverse(stop - start, stride=self._stride(room), room=room)

    def _stride(self, room: int) -> int:
        """Distance of the kept velocity grids; 0 where none are kept for such boxes."""
        return self.scratch.pitch * self.scratch.batch * room if room == self.room else 0
