"""Kernels made of the functions in forward.py and adjoint.py, in two shapes.

`serial`: one thread runs many substeps; on a CPU, where Warp runs threads one after the other, this leaves out the
launches. `parallel`: one launch per part of a substep, a thread per particle or node, for CUDA. Both run g2p of a substep
together with p2g of the next, and back again. Modules are built per law and scalar type when first used, the adjoint
apart from the forward pass.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .adjoint import adjoint
from .common import common
from .contact import contact
from .forward import forward

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

OPTIONS = {"enable_backward": False, "max_unroll": 3}


def kernel(name: str, law: str, real: type, nodal: bool, bordered: bool) -> Any:
    """Decorator that puts a kernel into the Warp module of this name and variant."""
    module = wp.get_module(f"diffphys_ros.simulate.{name}_{law}_{real.__name__}" + "_nodal" * nodal + "_bordered" * bordered)
    module.options |= OPTIONS
    return wp.kernel(enable_backward=False, module=module)


@cache
def particle_forward(law: str, real: type, nodal: bool, bordered: bool) -> SimpleNamespace:
    """Warp functions over one particle: `begin` a run of substeps, `advance` to the next slot and begin from there."""
    part, t = forward(law, real, nodal, bordered), common(real)
    p2g, g2p, check, load, store, material_of = part.p2g, part.g2p, part.check, t.load, t.store, t.material_of

    @wp.func
    def begin(p: int, lattice: t.Lattice, slot: int, states: t.States, materials: t.Materials, momentum: wp.array(dtype=t.vec4)):
        p2g(lattice, load(states, slot, p), material_of(materials, p), materials.node_force, momentum)

    @wp.func
    def advance(
        p: int,
        lattice: t.Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        ends: bool,
        at: int,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        flag: wp.array(dtype=wp.int64),
    ):
        material = material_of(materials, p)
        after = g2p(lattice, load(states, slot, p), material, at, velocity)
        store(states, next_slot, p, after)
        check(p, lattice, after, substep, states.x.shape[1], flag)
        if not ends:
            p2g(lattice, after, material, materials.node_force, momentum)

    return SimpleNamespace(begin=begin, advance=advance)


@cache
def particle_adjoint(law: str, real: type, nodal: bool, bordered: bool) -> SimpleNamespace:
    """Warp functions over one particle: `enter` a run of substeps from its end, `retreat` over p2g and the g2p before it."""
    part, t = adjoint(law, real, nodal, bordered), common(real)
    g2p_adjoint, p2g_adjoint, load, store, material_of, put_material = (
        part.g2p_adjoint,
        part.p2g_adjoint,
        t.load,
        t.store,
        t.material_of,
        t.put_material,
    )

    @wp.func
    def enter(
        p: int,
        lattice: t.Lattice,
        slot: int,
        at: int,
        states: t.States,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        bars: t.States,
        materials_bar: t.Materials,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        bar, material_bar = g2p_adjoint(
            lattice,
            load(states, slot, p),
            load(states, slot + 1, p),
            material_of(materials, p),
            at,
            velocity,
            load(bars, 0, p),
            material_of(materials_bar, p),
            velocity_bar,
        )
        store(bars, 0, p, bar)
        put_material(materials_bar, p, material_bar)

    @wp.func
    def retreat(
        p: int,
        lattice: t.Lattice,
        slot: int,
        at: int,
        states: t.States,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        bars: t.States,
        materials_bar: t.Materials,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        material, particle = material_of(materials, p), load(states, slot, p)
        bar, material_bar = p2g_adjoint(
            lattice,
            particle,
            material,
            materials.node_force,
            momentum_bar,
            load(bars, 0, p),
            material_of(materials_bar, p),
            materials_bar.node_force,
        )
        if slot > 0:
            bar, material_bar = g2p_adjoint(
                lattice, load(states, slot - 1, p), particle, material, at, velocity, bar, material_bar, velocity_bar
            )
        store(bars, 0, p, bar)
        put_material(materials_bar, p, material_bar)

    return SimpleNamespace(enter=enter, retreat=retreat)


@cache
def serial_forward(law: str, real: type, nodal: bool, bordered: bool) -> Any:
    """Kernel of one thread: substeps start .. stop - 1. With keep = 1 every state has its slot, and velocities start at
    slot * stride; with keep = 0 all happens in slot 0."""
    grid, part, t = forward(law, real, nodal, bordered).grid, particle_forward(law, real, nodal, bordered), common(real)
    Borders = contact(real, bordered).Borders
    begin, advance = part.begin, part.advance

    @kernel("serial_forward", law, real, nodal, bordered)
    def run(
        # in:
        lattice: t.Lattice,
        start: int,
        stop: int,
        keep: int,
        stride: int,
        materials: t.Materials,
        drag: wp.array(dtype=real),
        borders: Borders,
        # out:
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        velocity: wp.array(dtype=t.vec4),
        flag: wp.array(dtype=wp.int64),
    ):
        particles = states.x.shape[1]
        for p in range(particles):
            begin(p, lattice, 0, states, materials, momentum)
        for n in range(start, stop):
            slot = (n - start) * keep
            for i in range(lattice.nx * lattice.ny * lattice.nz):
                grid(i, lattice, slot * stride, n, drag, borders, momentum, velocity)
            for p in range(particles):
                advance(p, lattice, slot, slot + keep, n, n + 1 == stop, slot * stride, materials, velocity, states, momentum, flag)

    return run


@cache
def serial_adjoint(law: str, real: type, nodal: bool, bordered: bool) -> Any:
    """Kernel of one thread: back over the substeps of slots count - 1 .. 0; velocities are recomputed where stride = 0."""
    grid, grid_adjoint, t = forward(law, real, nodal, bordered).grid, adjoint(law, real, nodal, bordered).grid_adjoint, common(real)
    Borders = contact(real, bordered).Borders
    begin, part = particle_forward(law, real, nodal, bordered).begin, particle_adjoint(law, real, nodal, bordered)
    enter, retreat = part.enter, part.retreat

    @kernel("serial_adjoint", law, real, nodal, bordered)
    def reverse(
        # in:
        lattice: t.Lattice,
        start: int,
        count: int,
        stride: int,
        materials: t.Materials,
        drag: wp.array(dtype=real),
        borders: Borders,
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        velocity: wp.array(dtype=t.vec4),
        # out:
        bars: t.States,
        materials_bar: t.Materials,
        velocity_bar: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        drag_bar: wp.array(dtype=real),
        borders_bar: Borders,
    ):
        particles = states.x.shape[1]
        nodes = lattice.nx * lattice.ny * lattice.nz
        for back in range(count + 1):
            slot = count - back
            if slot < count:
                for i in range(nodes):
                    grid_adjoint(
                        i, lattice, slot * stride, start + slot, drag, borders, velocity, velocity_bar, momentum_bar, drag_bar, borders_bar
                    )
            if stride == 0 and slot > 0:
                for p in range(particles):
                    begin(p, lattice, slot - 1, states, materials, momentum)
                for i in range(nodes):
                    grid(i, lattice, 0, start + slot - 1, drag, borders, momentum, velocity)
            for p in range(particles):
                if slot == count:
                    enter(p, lattice, slot - 1, (slot - 1) * stride, states, materials, velocity, bars, materials_bar, velocity_bar)
                else:
                    retreat(
                        p,
                        lattice,
                        slot,
                        (slot - 1) * stride,
                        states,
                        materials,
                        velocity,
                        momentum_bar,
                        bars,
                        materials_bar,
                        velocity_bar,
                    )

    return reverse


@cache
def parallel_forward(law: str, real: type, nodal: bool, bordered: bool) -> SimpleNamespace:
    """Kernels begin and advance over particles, grid over nodes."""
    grid_of, part, t = forward(law, real, nodal, bordered).grid, particle_forward(law, real, nodal, bordered), common(real)
    Borders = contact(real, bordered).Borders
    begin_of, advance_of = part.begin, part.advance
    of_module = kernel("parallel_forward", law, real, nodal, bordered)

    @of_module
    def begin(lattice: t.Lattice, slot: int, states: t.States, materials: t.Materials, momentum: wp.array(dtype=t.vec4)):
        begin_of(wp.tid(), lattice, slot, states, materials, momentum)

    @of_module
    def grid(
        lattice: t.Lattice,
        at: int,
        substep: int,
        drag: wp.array(dtype=real),
        borders: Borders,
        momentum: wp.array(dtype=t.vec4),
        velocity: wp.array(dtype=t.vec4),
    ):
        grid_of(wp.tid(), lattice, at, substep, drag, borders, momentum, velocity)

    @of_module
    def advance(
        lattice: t.Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        ends: int,
        at: int,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        flag: wp.array(dtype=wp.int64),
    ):
        advance_of(wp.tid(), lattice, slot, next_slot, substep, ends != 0, at, materials, velocity, states, momentum, flag)

    return SimpleNamespace(begin=begin, grid=grid, advance=advance)


@cache
def parallel_adjoint(law: str, real: type, nodal: bool, bordered: bool) -> SimpleNamespace:
    """Kernels enter and retreat over particles, grid_adjoint over nodes."""
    grid_of, part, t = adjoint(law, real, nodal, bordered).grid_adjoint, particle_adjoint(law, real, nodal, bordered), common(real)
    Borders = contact(real, bordered).Borders
    enter_of, retreat_of = part.enter, part.retreat
    of_module = kernel("parallel_adjoint", law, real, nodal, bordered)

    @of_module
    def enter(
        lattice: t.Lattice,
        slot: int,
        at: int,
        states: t.States,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        bars: t.States,
        materials_bar: t.Materials,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        enter_of(wp.tid(), lattice, slot, at, states, materials, velocity, bars, materials_bar, velocity_bar)

    @of_module
    def grid_adjoint(
        lattice: t.Lattice,
        at: int,
        substep: int,
        drag: wp.array(dtype=real),
        borders: Borders,
        velocity: wp.array(dtype=t.vec4),
        velocity_bar: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        drag_bar: wp.array(dtype=real),
        borders_bar: Borders,
    ):
        grid_of(wp.tid(), lattice, at, substep, drag, borders, velocity, velocity_bar, momentum_bar, drag_bar, borders_bar)

    @of_module
    def retreat(
        lattice: t.Lattice,
        slot: int,
        at: int,
        states: t.States,
        materials: t.Materials,
        velocity: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        bars: t.States,
        materials_bar: t.Materials,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        retreat_of(wp.tid(), lattice, slot, at, states, materials, velocity, momentum_bar, bars, materials_bar, velocity_bar)

    return SimpleNamespace(enter=enter, grid_adjoint=grid_adjoint, retreat=retreat)
