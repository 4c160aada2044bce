"""Kernels made of the functions in forward.py and adjoint.py, in two shapes.

`serial`: one thread runs many substeps; on a CPU, where Warp runs threads one after the other, this leaves out the
launches. `parallel`: one launch per part of a substep, a thread per particle or node, for CUDA. Modules are built per
law and scalar type when first used, the adjoint apart from the forward pass.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .adjoint import adjoint
from .common import common
from .forward import forward

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

OPTIONS = {"enable_backward": False, "max_unroll": 3}


def kernel(name: str, law: str, real: type, nodal: bool) -> Any:
    """Decorator that puts a kernel into the Warp module of this name and variant."""
    module = wp.get_module(f"diffphys_ros.simulate.{name}_{law}_{real.__name__}" + ("_nodal" if nodal else ""))
    module.options |= OPTIONS
    return wp.kernel(enable_backward=False, module=module)


@cache
def serial_forward(law: str, real: type, nodal: bool) -> Any:
    """Kernel of one thread: substeps start .. stop - 1. With keep = 1 every state has its slot, and velocities start at
    slot * stride; with keep = 0 all happens in slot 0."""
    part, t = forward(law, real, nodal), common(real)
    vec4, Lattice, States, Material = t.vec4, t.Lattice, t.States, t.Material
    p2g, grid, g2p = part.p2g, part.grid, part.g2p

    @kernel("serial_forward", law, real, nodal)
    def run(
        # in:
        lattice: Lattice,
        start: int,
        stop: int,
        keep: int,
        stride: int,
        material: Material,
        drag: wp.array(dtype=real),
        # out:
        states: States,
        momentum: wp.array(dtype=vec4),
        velocity: wp.array(dtype=vec4),
        flag: wp.array(dtype=wp.int64),
    ):
        for n in range(start, stop):
            slot = (n - start) * keep
            for p in range(states.x.shape[1]):
                p2g(p, lattice, slot, states, material, momentum)
            for i in range(lattice.nx * lattice.ny * lattice.nz):
                grid(i, lattice, slot * stride, drag, momentum, velocity)
            for p in range(states.x.shape[1]):
                g2p(p, lattice, slot, slot + keep, n, slot * stride, velocity, states, flag)

    return run


@cache
def serial_adjoint(law: str, real: type, nodal: bool) -> Any:
    """Kernel of one thread: back over the substeps of slots count - 1 .. 0; velocities are recomputed where stride = 0."""
    part, back, t = forward(law, real, nodal), adjoint(law, real, nodal), common(real)
    vec4, Lattice, States, Material, StateBar = t.vec4, t.Lattice, t.States, t.Material, t.StateBar
    p2g, grid = part.p2g, part.grid
    g2p_adjoint, grid_adjoint, p2g_adjoint = back.g2p_adjoint, back.grid_adjoint, back.p2g_adjoint

    @kernel("serial_adjoint", law, real, nodal)
    def reverse(
        # in:
        lattice: Lattice,
        count: int,
        stride: int,
        material: Material,
        drag: wp.array(dtype=real),
        states: States,
        momentum: wp.array(dtype=vec4),
        velocity: wp.array(dtype=vec4),
        # out:
        bar: StateBar,
        material_bar: Material,
        velocity_bar: wp.array(dtype=vec4),
        momentum_bar: wp.array(dtype=vec4),
        drag_bar: wp.array(dtype=real),
    ):
        particles = states.x.shape[1]
        nodes = lattice.nx * lattice.ny * lattice.nz
        for back in range(count):
            slot = count - 1 - back
            if stride == 0:
                for p in range(particles):
                    p2g(p, lattice, slot, states, material, momentum)
                for i in range(nodes):
                    grid(i, lattice, 0, drag, momentum, velocity)
            for p in range(particles):
                g2p_adjoint(p, lattice, slot, slot + 1, slot * stride, states, velocity, bar, velocity_bar)
            for i in range(nodes):
                grid_adjoint(i, slot * stride, drag, velocity, velocity_bar, momentum_bar, drag_bar)
            for p in range(particles):
                p2g_adjoint(p, lattice, slot, states, material, momentum_bar, bar, material_bar)

    return reverse


@cache
def parallel_forward(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Kernels p2g and g2p over particles, grid over nodes."""
    part, t = forward(law, real, nodal), common(real)
    vec4, Lattice, States, Material = t.vec4, t.Lattice, t.States, t.Material
    p2g_of, grid_of, g2p_of = part.p2g, part.grid, part.g2p
    of_module = kernel("parallel_forward", law, real, nodal)

    @of_module
    def p2g(lattice: Lattice, slot: int, states: States, material: Material, momentum: wp.array(dtype=vec4)):
        p2g_of(wp.tid(), lattice, slot, states, material, momentum)

    @of_module
    def grid(lattice: Lattice, at: int, drag: wp.array(dtype=real), momentum: wp.array(dtype=vec4), velocity: wp.array(dtype=vec4)):
        grid_of(wp.tid(), lattice, at, drag, momentum, velocity)

    @of_module
    def g2p(
        lattice: Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        at: int,
        velocity: wp.array(dtype=vec4),
        states: States,
        flag: wp.array(dtype=wp.int64),
    ):
        g2p_of(wp.tid(), lattice, slot, next_slot, substep, at, velocity, states, flag)

    return SimpleNamespace(p2g=p2g, grid=grid, g2p=g2p)


@cache
def parallel_adjoint(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Kernels g2p_adjoint and p2g_adjoint over particles, grid_adjoint over nodes."""
    part, t = adjoint(law, real, nodal), common(real)
    vec4, Lattice, States, Material, StateBar = t.vec4, t.Lattice, t.States, t.Material, t.StateBar
    g2p_of, grid_of, p2g_of = part.g2p_adjoint, part.grid_adjoint, part.p2g_adjoint
    of_module = kernel("parallel_adjoint", law, real, nodal)

    @of_module
    def g2p_adjoint(
        lattice: Lattice,
        slot: int,
        next_slot: int,
        at: int,
        states: States,
        velocity: wp.array(dtype=vec4),
        bar: StateBar,
        velocity_bar: wp.array(dtype=vec4),
    ):
        g2p_of(wp.tid(), lattice, slot, next_slot, at, states, velocity, bar, velocity_bar)

    @of_module
    def grid_adjoint(
        at: int,
        drag: wp.array(dtype=real),
        velocity: wp.array(dtype=vec4),
        velocity_bar: wp.array(dtype=vec4),
        momentum_bar: wp.array(dtype=vec4),
        drag_bar: wp.array(dtype=real),
    ):
        grid_of(wp.tid(), at, drag, velocity, velocity_bar, momentum_bar, drag_bar)

    @of_module
    def p2g_adjoint(
        lattice: Lattice,
        slot: int,
        states: States,
        material: Material,
        momentum_bar: wp.array(dtype=vec4),
        bar: StateBar,
        material_bar: Material,
    ):
        p2g_of(wp.tid(), lattice, slot, states, material, momentum_bar, bar, material_bar)

    return SimpleNamespace(g2p_adjoint=g2p_adjoint, grid_adjoint=grid_adjoint, p2g_adjoint=p2g_adjoint)
