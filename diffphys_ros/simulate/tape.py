"""Consecutive substep states of one frame, and the recorded launches that fill them and run back over them."""

from __future__ import annotations

from typing import Any

import warp as wp
from torch import Tensor

from .adjoint import adjoint
from .box import Box
from .kernels import forward
from .scratch import Scratch
from .state import WIDTH

LATTICE, SLOT, NEXT_SLOT, SUBSTEP = 0, 1, 2, 3  # places of these kernel arguments, where a kernel has them


class Tape:
    """States (length + 1, P, 24), and nodal velocities of each substep or of one (where `velocity_nodes` is 0)."""

    def __init__(self, scratch: Scratch, length: int, *, velocity_nodes: int, variant: tuple[Any, ...]):
        self.scratch, self.variant = scratch, variant
        self.states = scratch.volume.new_zeros(length + 1, len(scratch.volume), WIDTH)
        self.velocity_nodes = velocity_nodes
        self.velocity = scratch.volume.new_zeros(max(length * velocity_nodes, scratch.nodes), 4)
        self._forward: list[wp.Launch] = []
        self._adjoint: list[wp.Launch] = []
        self.box = Box((0, 0, 0), (0, 0, 0))

    @property
    def keeps_velocity(self) -> bool:
        """Whether the present box leaves room for the velocities of every substep."""
        return self.box.nodes <= self.velocity_nodes

    def enter(self, box: Box, lattice: Any) -> None:
        """Run on this box of the grid from now on."""
        self.box = box
        for command in self._launches():
            command.set_param_at_index(LATTICE, lattice)
        self._launches()[1].set_dim(box.nodes)
        if self._adjoint:
            for command in (self._adjoint[0], self._adjoint[2]):
                command.set_param_at_index(LATTICE, lattice)
            self._adjoint[1].set_dim(box.nodes)
        self.lattice = lattice

    def run(self, data: Tensor, start: int, stop: int, *, keep: bool) -> Tensor:
        """State (P, 24) after substeps start .. stop - 1 from `data`; a view, which the next run overwrites.

        With `keep` every state stays, and the velocities where there is room: what `reverse` needs.
        """
        self.states[0].copy_(data)
        p2g, grid, g2p = self._launches()
        stride = self.box.nodes if keep and self.keeps_velocity else 0
        for n in range(start, stop):
            slot, after = (n - start, n - start + 1) if keep else (0, 0)
            p2g.set_param_at_index(SLOT, slot)
            grid.set_param_at_index(SLOT, slot * stride)
            g2p.set_param_at_index(SLOT, slot)
            g2p.set_param_at_index(NEXT_SLOT, after)
            g2p.set_param_at_index(SUBSTEP, n)
            g2p.set_param_at_index(SUBSTEP + 1, slot * stride)
            p2g.launch()
            grid.launch()
            g2p.launch()
        return self.states[after]

    def reverse(self, substeps: int) -> None:
        """Take the adjoint in scratch.state_bar from after the last kept substep to before the first of `substeps`."""
        g2p_adjoint, grid_adjoint, p2g_adjoint = self._adjoint_launches()
        stride = self.box.nodes if self.keeps_velocity else 0
        for slot in reversed(range(substeps)):
            if not stride:
                self._recompute_velocity(slot)
            g2p_adjoint.set_param_at_index(SLOT, slot)
            g2p_adjoint.set_param_at_index(NEXT_SLOT, slot + 1)
            g2p_adjoint.set_param_at_index(NEXT_SLOT + 1, slot * stride)
            grid_adjoint.set_param_at_index(0, slot * stride)
            p2g_adjoint.set_param_at_index(SLOT, slot)
            g2p_adjoint.launch()
            grid_adjoint.launch()
            p2g_adjoint.launch()

    def _recompute_velocity(self, slot: int) -> None:
        p2g, grid, _ = self._launches()
        p2g.set_param_at_index(SLOT, slot)
        grid.set_param_at_index(SLOT, 0)
        p2g.launch()
        grid.launch()

    def _launches(self) -> list[wp.Launch]:
        if not self._forward:
            k, s, state = forward(*self.variant), self.scratch, self.scratch.fields(self.states)
            momentum, velocity = s.see(s.momentum, 4), s.see(self.velocity, 4)
            lattice = k.Lattice()
            self._forward = [
                self._command(k.p2g, [lattice, 0, *state, *s.material(), momentum]),
                self._command(k.grid, [lattice, 0, s.see(s.inputs.keep), momentum, velocity]),
                self._command(k.g2p, [lattice, 0, 0, 0, 0, velocity, *state, s.see(s.flag)]),
            ]
        return self._forward

    def _adjoint_launches(self) -> list[wp.Launch]:
        if not self._adjoint:
            k, s, state = adjoint(*self.variant), self.scratch, self.scratch.fields(self.states)
            b, see = s.inputs_bar, s.see
            x_bar, v_bar, C_bar, F_bar = s.fields(s.state_bar)
            velocity, velocity_bar, momentum_bar = see(self.velocity, 4), see(s.velocity_bar, 4), see(s.momentum_bar, 4)
            bars = [x_bar, v_bar, C_bar, F_bar, see(b.mu), see(b.lam), see(b.body, 3), see(b.mass), see(b.node_force, 3)]
            to_grid = [self.lattice, 0, 0, 0, *state, velocity, v_bar, C_bar, x_bar, F_bar, velocity_bar]
            self._adjoint = [
                self._command(k.g2p_adjoint, to_grid),
                self._command(k.grid_adjoint, [0, see(s.inputs.keep), velocity, velocity_bar, momentum_bar, see(s.keep_bar)]),
                self._command(k.p2g_adjoint, [self.lattice, 0, *state, *s.material(), momentum_bar, *bars]),
            ]
            self._adjoint[1].set_dim(self.box.nodes)
        return self._adjoint

    def _command(self, kernel: Any, inputs: list[Any]) -> wp.Launch:
        count, device = len(self.scratch.volume), str(self.scratch.volume.device)
        return wp.launch(kernel, dim=count, inputs=inputs, device=device, record_cmd=True)
