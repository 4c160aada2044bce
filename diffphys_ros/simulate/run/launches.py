"""Recorded launches over one tape: run substeps forward, go back over them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import torch
import warp as wp
from torch import Tensor

from ..substep.kernels import parallel_adjoint, parallel_forward, serial_adjoint, serial_forward
from ..substep.shared_inputs import Variant
from .box import enclosing
from .buffers import Scratch

FEW, SMALL_BLOCK, BLOCK = 20_000, 32, 64  # particles up to which small blocks (of CUDA threads) spread a body over the chip


@dataclass
class TapeArrays:
    """What a program works on."""

    scratch: Scratch
    states: Tensor  # shape (slots, B, P, 24)
    velocity: Tensor  # kept velocity grids, shape (slots x B x room x pitch, 4)
    variant: Variant

    @property
    def device(self) -> torch.device:
        """Where all of it lies."""
        return self.states.device

    def forward(self, kept: bool) -> list[Any]:
        """Arrays of the forward kernels after `world`; velocities are those of the tape where they are `kept`."""
        s = self.scratch
        return [s.states(self.states), s.see(s.momentum, 4), self._velocity(kept), s.see(s.flags)]

    def adjoint(self, kept: bool) -> list[Any]:
        """Arrays of the adjoint kernels after `world`."""
        s = self.scratch
        known = [s.states(self.states), s.see(s.momentum, 4), self._velocity(kept)]
        return [*known, s.bars, s.world_bar, s.see(s.velocity_bar, 4), s.see(s.momentum_bar, 4)]

    def enclosure(self, room: int) -> list[wp.Launch]:
        """The two launches that make the boxes."""
        s, kernels = self.scratch, enclosing(self.variant.real, self.variant.bordered)
        extents, flags, count = wp.from_torch(s.extents), s.see(s.flags), s.batch * len(s.volume)
        return [
            self.launch(kernels.reach, count, [s.world, s.states(self.states), s.frame_s, int(self.variant.anchored), extents, flags]),
            self.launch(kernels.settle, s.batch, [s.world, room, extents, flags]),
        ]

    def launch(self, kernel: Any, dim: Any, inputs: list[Any]) -> wp.Launch:
        """A recorded launch."""
        block = SMALL_BLOCK if self.scratch.batch * len(self.scratch.volume) <= FEW else BLOCK
        return wp.launch(kernel, dim=dim, inputs=inputs, device=str(self.device), record_cmd=True, block_dim=block)

    def _velocity(self, kept: bool) -> Any:
        return self.scratch.see(self.velocity if kept else self.scratch.velocity, 4)


class Program(Protocol):
    """How the substeps of a tape are launched. `stride` is the distance of kept velocity grids, 0 where none are kept;
    boxes lie `room` nodes apart."""

    def __init__(self, view: TapeArrays): ...

    def run(self, count: int, *, keep: bool, stride: int, room: int, enclose: bool) -> None:
        """`count` substeps from the state in slot 0; into slots 1, 2, .. with `keep`, else into 1 and 0 in turns. With
        `enclose` boxes are made around that state first."""

    def reverse(self, count: int, *, stride: int, room: int) -> None:
        """The adjoint in scratch from after slot `count` to before slot 0."""


class Serial:
    """One launch a simulation for all substeps: for the CPU, whose cores take simulations in turns."""

    def __init__(self, view: TapeArrays):
        self.view = view
        self._recorded: dict[Any, list[wp.Launch]] = {}

    def run(self, count: int, *, keep: bool, stride: int, room: int, enclose: bool) -> None:
        if enclose:
            for command in self._enclosure(room):
                command.launch()
        self._launch(serial_forward, self.view.forward, stride, {1: count, 2: int(keep), 3: stride})

    def reverse(self, count: int, *, stride: int, room: int) -> None:
        self._launch(serial_adjoint, self.view.adjoint, stride, {1: count, 2: stride})

    def _enclosure(self, room: int) -> list[wp.Launch]:
        if room not in self._recorded:
            self._recorded[room] = self.view.enclosure(room)
        return self._recorded[room]

    def _launch(self, kernel: Any, arrays: Callable[[bool], list[Any]], stride: int, numbers: dict[int, int]) -> None:
        v = self.view
        key = kernel, v.scratch.version, stride > 0
        if key not in self._recorded:
            values = [*numbers.values(), v.scratch.world, *arrays(stride > 0)]
            self._recorded[key] = [v.launch(kernel(v.variant), 1, [b, *values]) for b in range(v.scratch.batch)]
        for command in self._recorded[key]:
            for index, value in numbers.items():
                command.set_param_at_index(index, value)
        _spread([command.launch for command in self._recorded[key]])


def _spread(tasks: list[Callable[[], None]]) -> None:
    """Run all, on all cores: a launch leaves Python's lock."""
    if len(tasks) == 1:
        tasks[0]()
    else:
        list(_pool().map(lambda task: task(), tasks))


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(len(os.sched_getaffinity(0)), thread_name_prefix="simulate")


class Parallel:
    """A launch for each part of a substep, over all simulations: for CUDA, where a whole run is one graph."""

    def __init__(self, view: TapeArrays):
        self.view = view
        self._graphs: dict[Any, Any] = {}

    def run(self, count: int, *, keep: bool, stride: int, room: int, enclose: bool) -> None:
        self._play(("run", count, keep, stride, room, enclose), lambda: self._run(count, keep, stride, room, enclose))

    def reverse(self, count: int, *, stride: int, room: int) -> None:
        self._play(("reverse", count, stride, room), lambda: self._reverse(count, stride, room))

    def _run(self, count: int, keep: bool, stride: int, room: int, enclose: bool) -> Iterable[tuple[wp.Launch, dict[int, int]]]:
        for command in self.view.enclosure(room) if enclose else ():
            yield command, {}
        begin, grid, advance = self._forward(stride > 0, room)
        yield begin, {0: 0}
        for n in range(count):
            slot, after = (n, n + 1) if keep else (n % 2, (n + 1) % 2)
            yield grid, {0: slot * stride, 1: n}
            yield advance, {0: slot, 1: after, 2: n, 3: int(n + 1 == count), 4: slot * stride}

    def _reverse(self, count: int, stride: int, room: int) -> Iterable[tuple[wp.Launch, dict[int, int]]]:
        begin, grid, _ = self._forward(stride > 0, room)
        enter, grid_adjoint, retreat = self._adjoint(stride > 0, room)
        for slot in reversed(range(count + 1)):
            if slot < count:
                yield grid_adjoint, {0: slot * stride, 1: slot}
            if not stride and slot:
                yield begin, {0: slot - 1}
                yield grid, {0: 0, 1: slot - 1}
            yield (retreat, {0: slot, 1: (slot - 1) * stride}) if slot < count else (enter, {0: slot - 1, 1: (slot - 1) * stride})

    def _forward(self, kept: bool, room: int) -> list[wp.Launch]:
        v, s, k = self.view, self.view.scratch, parallel_forward(self.view.variant)
        states, momentum, velocity, flags = v.forward(kept)
        count = s.batch * len(s.volume)
        return [
            v.launch(k.begin, count, [0, s.world, states, momentum]),
            v.launch(k.grid, (s.batch, room), [0, 0, room, s.world, momentum, velocity]),
            v.launch(k.advance, count, [0, 0, 0, 0, 0, s.world, velocity, states, momentum, flags]),
        ]

    def _adjoint(self, kept: bool, room: int) -> list[wp.Launch]:
        v, s, k = self.view, self.view.scratch, parallel_adjoint(self.view.variant)
        states, _, velocity, bars, world_bar, velocity_bar, momentum_bar = v.adjoint(kept)
        count = s.batch * len(s.volume)
        return [
            v.launch(k.enter, count, [0, 0, s.world, states, velocity, bars, world_bar, velocity_bar]),
            v.launch(k.grid_adjoint, (s.batch, room), [0, 0, room, s.world, velocity, world_bar, velocity_bar, momentum_bar]),
            v.launch(k.retreat, count, [0, 0, s.world, states, velocity, momentum_bar, bars, world_bar, velocity_bar]),
        ]

    def _play(self, key: tuple[Any, ...], steps: Callable[[], Iterable[tuple[wp.Launch, dict[int, int]]]]) -> None:
        """Launch the steps; on CUDA as a graph, captured when first asked for. A graph queues where torch's copies do."""
        if self.view.device.type != "cuda":
            return _issue(steps())
        key = (*key, self.view.scratch.version)
        if key not in self._graphs:
            self._graphs = {k: g for k, g in self._graphs.items() if k[-1] == key[-1]}
            self._graphs[key] = self._capture(list(steps()))
        wp.capture_launch(self._graphs[key], stream=wp.stream_from_torch(torch.cuda.current_stream(self.view.device)))

    def _capture(self, steps: list[tuple[wp.Launch, dict[int, int]]]) -> Any:
        stream = wp.Stream(str(self.view.device))
        with wp.ScopedStream(stream, sync_enter=False):
            wp.capture_begin(stream=stream, force_module_load=False)
            try:
                _issue(steps)
            finally:
                graph = wp.capture_end(stream=stream)
        return graph


def _issue(steps: Iterable[tuple[wp.Launch, dict[int, int]]]) -> None:
    for command, numbers in steps:
        for index, value in numbers.items():
            command.set_param_at_index(index, value)
        command.launch()


PROGRAMS: dict[str, type[Program]] = {"cpu": Serial, "cuda": Parallel}  # by torch device type
