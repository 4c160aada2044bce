"""Recorded launches over one tape: run substeps forward, go back over them."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import torch
import warp as wp
from torch import Tensor

from .kernels import parallel_adjoint, parallel_forward, serial_adjoint, serial_forward
from .scratch import Scratch


@dataclass
class View:
    """What a program works on: Warp's views of a tape and of the scratch arrays, and the present box."""

    scratch: Scratch
    states: Tensor  # shape (slots, P, 24)
    velocity: Tensor  # shape (nodes or slots x nodes, 4)
    variant: tuple[Any, ...]  # law, scalar type, nodal, bordered
    lattice: Any = None
    nodes: int = 0

    def launch(self, kernel: Any, dim: int, inputs: list[Any]) -> wp.Launch:
        """A recorded launch."""
        return wp.launch(kernel, dim=dim, inputs=inputs, device=str(self.states.device), record_cmd=True)


class Program(Protocol):
    """How the substeps of a tape are launched. `stride` is the distance of kept velocity grids, 0 where one is kept."""

    def __init__(self, view: View): ...

    def run(self, start: int, stop: int, *, keep: bool, stride: int) -> None:
        """Substeps start .. stop - 1 from the state in slot 0; into slots 1, 2, .. with `keep`, else all in slot 0."""

    def reverse(self, start: int, count: int, *, stride: int) -> None:
        """The adjoint in scratch from after slot `count` to before slot 0, the state before substep `start`."""


class Serial:
    """One launch for all substeps: for the CPU."""

    def __init__(self, view: View):
        self.view = view

    def run(self, start: int, stop: int, *, keep: bool, stride: int) -> None:
        for index, value in enumerate((self.view.lattice, start, stop, int(keep), stride)):
            self._forward.set_param_at_index(index, value)
        self._forward.launch()

    def reverse(self, start: int, count: int, *, stride: int) -> None:
        for index, value in enumerate((self.view.lattice, start, count, stride)):
            self._adjoint.set_param_at_index(index, value)
        self._adjoint.launch()

    @cached_property
    def _forward(self) -> wp.Launch:
        v, s = self.view, self.view.scratch
        inputs = [v.lattice, 0, 0, 0, 0, s.materials, s.drag, s.borders]
        outputs = [s.states(v.states), s.momentum_view, s.see(v.velocity, 4), s.see(s.flag)]
        return v.launch(serial_forward(*v.variant), 1, inputs + outputs)

    @cached_property
    def _adjoint(self) -> wp.Launch:
        v, s = self.view, self.view.scratch
        known = [s.materials, s.drag, s.borders, s.states(v.states), s.momentum_view, s.see(v.velocity, 4)]
        bars = [s.bars, s.materials_bar, s.see(s.velocity_bar, 4), s.see(s.momentum_bar, 4), s.see(s.drag_bar), s.borders_bar]
        return v.launch(serial_adjoint(*v.variant), 1, [v.lattice, 0, 0, 0, *known, *bars])


class Parallel:
    """A launch for each part of a substep, without waiting for the device in between: for CUDA."""

    def __init__(self, view: View):
        self.view = view

    def run(self, start: int, stop: int, *, keep: bool, stride: int) -> None:
        begin, grid, advance = self._enter(self._forward)
        with _torch_stream(self.view.states.device):
            _launch(begin, {1: 0})
            for n in range(start, stop):
                slot = (n - start) * keep
                _launch(grid, {1: slot * stride, 2: n})
                _launch(advance, {1: slot, 2: slot + keep, 3: n, 4: int(n + 1 == stop), 5: slot * stride})

    def reverse(self, start: int, count: int, *, stride: int) -> None:
        begin, grid, _ = self._enter(self._forward)
        enter, grid_adjoint, retreat = self._enter(self._adjoint)
        with _torch_stream(self.view.states.device):
            for slot in reversed(range(count + 1)):
                if slot < count:
                    _launch(grid_adjoint, {1: slot * stride, 2: start + slot})
                if not stride and slot:
                    _launch(begin, {1: slot - 1})
                    _launch(grid, {1: 0, 2: start + slot - 1})
                if slot < count:
                    _launch(retreat, {1: slot, 2: (slot - 1) * stride})
                else:
                    _launch(enter, {1: slot - 1, 2: (slot - 1) * stride})

    def _enter(self, launches: list[wp.Launch]) -> list[wp.Launch]:
        """Set the present box; the middle launch runs over nodes."""
        launches[1].set_dim(self.view.nodes)
        for command in launches:
            command.set_param_at_index(0, self.view.lattice)
        return launches

    @cached_property
    def _forward(self) -> list[wp.Launch]:
        v, s, k = self.view, self.view.scratch, parallel_forward(*self.view.variant)
        count, states, velocity = len(s.volume), s.states(v.states), s.see(v.velocity, 4)
        return [
            v.launch(k.begin, count, [v.lattice, 0, states, s.materials, s.momentum_view]),
            v.launch(k.grid, v.nodes, [v.lattice, 0, 0, s.drag, s.borders, s.momentum_view, velocity]),
            v.launch(k.advance, count, [v.lattice, 0, 0, 0, 0, 0, s.materials, velocity, states, s.momentum_view, s.see(s.flag)]),
        ]

    @cached_property
    def _adjoint(self) -> list[wp.Launch]:
        v, s, k = self.view, self.view.scratch, parallel_adjoint(*self.view.variant)
        count, states, velocity = len(s.volume), s.states(v.states), s.see(v.velocity, 4)
        velocity_bar, momentum_bar = s.see(s.velocity_bar, 4), s.see(s.momentum_bar, 4)
        node_bars = [velocity_bar, momentum_bar, s.see(s.drag_bar), s.borders_bar]
        known, bars = [states, s.materials, velocity], [s.bars, s.materials_bar, velocity_bar]
        return [
            v.launch(k.enter, count, [v.lattice, 0, 0, *known, *bars]),
            v.launch(k.grid_adjoint, v.nodes, [v.lattice, 0, 0, s.drag, s.borders, velocity, *node_bars]),
            v.launch(k.retreat, count, [v.lattice, 0, 0, *known, momentum_bar, *bars]),
        ]


def _torch_stream(device: torch.device) -> AbstractContextManager[Any]:
    """Launch where torch's copies are queued, so that neither waits for the other."""
    if device.type != "cuda":
        return nullcontext()
    return wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(device)), sync_enter=False)


def _launch(command: wp.Launch, arguments: dict[int, int]) -> None:
    for index, value in arguments.items():
        command.set_param_at_index(index, value)
    command.launch()


PROGRAMS: dict[str, type[Program]] = {"cpu": Serial, "cuda": Parallel}  # by torch device type
