"""One frame forward, one frame backward: over the tape that was kept, or by replaying the frame from its first state."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass

import numpy as np
import warp as wp
from torch import Tensor

from ...types import Grid
from ..borders import Borders
from ..state import WIDTH
from ..substep.shared_inputs import Variant
from .box import NO_FLAG, rest_nodes
from .buffers import Inputs, Scratch
from .launches import PROGRAMS
from .sizes import NODE_VALUES, TapePlan
from .tape import Tape

BOX_ROOM = 1.5  # nodal arrays have room for boxes up to this times the largest so far


class Lease:
    """A tape lent to one frame's backward pass; returns by itself when the frame's graph is dropped."""

    def __init__(self, tape: Tape, free: list[Tape]):
        self.tape = tape
        self.give_back = weakref.finalize(self, free.append, tape)
        self.give_back.atexit = False


def _alive(known: weakref.ref[Lease]) -> Lease | None:
    """The lease, unless its tape is back."""
    lease = known()
    return lease if lease and lease.give_back.alive else None


@dataclass(frozen=True)
class Place:
    """The boxes that a frame ran on, `room` nodes apart, and its tape where one was kept; no boxes without gradients."""

    boxes: Tensor | None
    room: int
    lease: Lease | None


@dataclass(frozen=True)
class Run:
    """The last frame that ran forward."""

    tape: Tape
    data: Tensor  # its first states (B, P, 24)
    kept: bool


class Replay:
    """Everything that runs on the device, for one set of particles, grid, law, scalar type, number of substeps and batch."""

    def __init__(
        self,
        x_rest: Tensor,
        volume: Tensor,
        mean_mass: float,
        grid: Grid,
        *,
        batch: int,
        substeps: int,
        period_s: float,
        law: str,
        nodal: bool,
        anchored: bool,
        borders: Borders,
        budget: float,
        frames: int,
    ):
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # its banner and compile log are not ours to print
        wp.init()
        self.substeps, self.nodal, self.budget, self.frames = substeps, nodal, budget, frames
        self.scratch = Scratch(
            volume,
            grid,
            batch=batch,
            mean_mass=mean_mass,
            frame_s=period_s,
            nodal=nodal,
            borders=borders,
            substeps=substeps,
            anchored=anchored,
        )
        self.variant = Variant(law, self.scratch.real, nodal, bool(borders), self.scratch.planes, anchored)
        self.whole_nodes = math.prod(grid.size)
        self.state_bytes = volume.element_size() * WIDTH * batch * len(volume)
        self._present: Tensor | None = None  # the boxes that scratch holds, where a frame remembers them
        self.free: list[Tape] = []
        self.lent = 0
        self._leases: list[weakref.ref[Lease]] = []  # in the order in which frames ran
        self._last: Run | None = None
        self._chunk_tape: Tape | None = None
        self.once = self._tape(1, room=0)  # for runs that keep nothing
        self._make_room(self.whole_nodes if nodal else rest_nodes(grid, x_rest.cpu().numpy()))

    def forward(self, data: Tensor, values: tuple[Tensor, ...], *, keep: bool) -> tuple[Tensor, Place]:
        """States (B, P, 24) after one frame, and where it ran."""
        lease = self._lend() if keep else None
        tape = lease.tape if lease else self.once
        room = self.room
        after = self._attempt(tape, room, data, values, keep=lease is not None)
        flagged, nodes = self._status()
        if flagged and room < nodes <= self.whole_nodes:
            self._make_room(nodes)
            room = self.room
            after = self._attempt(tape, room, data, values, keep=lease is not None)
            flagged, _ = self._status()
        if flagged and room < self.whole_nodes:  # a particle outran its box
            room = self.whole_nodes
            after = self._attempt(tape, room, data, values, keep=lease is not None)
            flagged, _ = self._status()
        self.flagged = flagged
        self._present = self.scratch.boxes.clone() if keep else None
        return after.clone(), Place(self._present, room, lease)

    def backward(self, data: Tensor, values: tuple[Tensor, ...], next_bar: Tensor, place: Place) -> tuple[Tensor, Inputs]:
        """Adjoint of the states (B, P, 24) before the frame, and of the inputs (overwritten by the next call)."""
        self.scratch.begin_backward(values, None if place.boxes is self._present else place.boxes, next_bar)
        self._present = place.boxes
        lease = place.lease
        if lease and lease.give_back.alive:
            lease.tape.reverse(0, self.substeps, room=place.room)
            lease.give_back()
        else:
            self._replay(data, place.room)
        return self.scratch.state_bar.clone(), self.scratch.end_backward(place.room)

    def release(self) -> None:
        """Let the tapes go that no frame's graph holds; they are made again when a gradient is asked for."""
        self.lent -= len(self.free)
        self.free.clear()
        self._chunk_tape, self._marks = None, self.scratch.volume.new_zeros(0)
        if self._last is not None:
            self._last = Run(self.once, self._last.data, False)

    def bytes(self) -> int:
        """Memory once gradients were asked for, tapes that stay between passes included [bytes]."""
        per_tape = self.state_bytes * (self.plan.chunk + 1) + self.plan.chunk * self.velocity_bytes * self.plan.keep_velocity
        return per_tape * max(1, self.plan.kept) + self.state_bytes * (self.plan.marks + 2 + self.variant.anchored) + self.scratch.bytes()

    def first_flag(self) -> tuple[int, int, np.ndarray]:
        """Of the last frame: the first simulation that left its bounds, the code of its flag and the position [m] (3,) of the
        particle that raised it: after that substep where the states were kept, else at the frame's start."""
        flags = self.scratch.flags[:-1].cpu()
        simulation = int((flags != NO_FLAG).nonzero()[0])
        code, last = int(flags[simulation]), self._last
        assert last is not None
        substep, particle = divmod(code // 4, len(self.scratch.volume))
        states = last.tape.states[substep + 1] if last.kept else last.data
        return simulation, code, states[simulation, particle, :3].detach().cpu().numpy()

    def _attempt(self, tape: Tape, room: int, data: Tensor, values: tuple[Tensor, ...], *, keep: bool) -> Tensor:
        """States after the frame, on boxes in so much room; on the whole grid where there is room for it."""
        everything = room == self.whole_nodes
        self.scratch.reserve(room)
        self.scratch.begin_forward(values, self.scratch.whole if everything else None)
        self._last, self._present = Run(tape, data, keep), None
        return tape.run(data, 0, self.substeps, keep=keep, room=room, enclose=not everything)

    def _status(self) -> tuple[bool, int]:
        """Whether a particle raised a flag, and the nodes that the largest box wanted, in one copy from the device."""
        *codes, nodes = self.scratch.flags.tolist()
        flagged = min(codes) != NO_FLAG
        if flagged and self._last is not None:
            for velocity in (self._last.tape.velocity, self.scratch.velocity):
                velocity.zero_()  # nodes without mass are not written: nothing that is not finite may stay there
        return flagged, nodes

    def _make_room(self, nodes: int) -> None:
        """Boxes lie further apart from now on; frames that ran before keep theirs."""
        self.room = min(self.whole_nodes, int(BOX_ROOM * nodes))
        s = self.scratch
        s.reserve(self.room)
        self.velocity_bytes = s.volume.element_size() * NODE_VALUES * s.pitch * s.batch * self.room
        self.plan = TapePlan.within(self.budget, substeps=self.substeps, state=self.state_bytes, velocity=self.velocity_bytes, frames=self.frames)
        self._chunk_tape = None
        self._marks = s.volume.new_zeros(0)

    def _replay(self, data: Tensor, room: int) -> None:
        tape = self._replay_tape()
        starts = range(0, self.substeps, self.plan.chunk)
        marks = [data]
        for index, start in enumerate(starts[:-1]):
            after = self.once.run(marks[index], start, start + self.plan.chunk, keep=False, room=room)
            self._marks[index].copy_(after)
            marks.append(self._marks[index])
        for mark, start in zip(reversed(marks), reversed(starts), strict=True):
            stop = min(start + self.plan.chunk, self.substeps)
            tape.run(mark, start, stop, keep=True, room=room)
            tape.reverse(start, stop, room=room)

    def _replay_tape(self) -> Tape:
        """One to replay a frame on: a kept one that is free or, where all are lent, taken back from the frame that would
        need it last; that frame is replayed in turn."""
        if self.plan.kept:
            lent = next((lease for lease in map(_alive, self._leases) if lease), None)
            if not self.free and lent:
                lent.give_back()
            elif not self.free:
                self._add_tape()
            return self.free[-1]
        if self._chunk_tape is None:
            self._chunk_tape = self._tape(self.plan.chunk, room=0)
            self._marks = self.scratch.volume.new_zeros(max(self.plan.marks - 1, 0), *self.once.states.shape[1:])
        return self._chunk_tape

    def _lend(self) -> Lease | None:
        """A tape for a frame to keep, if there is one."""
        fitting = [tape for tape in self.free if tape.room == self.room]
        self.lent -= len(self.free) - len(fitting)
        self.free[:] = fitting
        if not self.free and self.lent < self.plan.kept:
            self._add_tape()
        if not self.free:
            return None
        lease = Lease(self.free.pop(), self.free)
        self._leases = [known for known in self._leases if _alive(known)] + [weakref.ref(lease)]
        return lease

    def _add_tape(self) -> None:
        self.lent += 1
        self.free.append(self._tape(self.substeps, room=self.room))

    def _tape(self, length: int, *, room: int) -> Tape:
        program = PROGRAMS[self.scratch.volume.device.type]
        return Tape(self.scratch, length, room=room, variant=self.variant, program=program)
