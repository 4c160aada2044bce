"""Kernels made of the functions in forward.py and adjoint.py, in two shapes.

`serial`: one thread runs many substeps of one simulation; on a CPU, where Warp runs threads one after the other, this
leaves out the launches. `parallel`: one launch per part of a substep, for CUDA, over the particles or nodes of all
simulations. Both run g2p of a substep together with p2g of the next, and back again. Modules are built per variant when
first used, the adjoint apart from the forward pass.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .adjoint import adjoint
from .common import common
from .forward import forward
from .plane_distance import approach
from .shared_inputs import Variant, world_of

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,name-defined,valid-type"

OPTIONS = {"enable_backward": False, "max_unroll": 3}


def kernel(name: str, variant: Variant) -> Any:
    """Decorator that puts a kernel into the Warp module of this name and variant."""
    module = wp.get_module(f"diffphys_ros.simulate.{name}_{variant.label}")
    module.options |= OPTIONS
    return wp.kernel(enable_backward=False, module=module)


@cache
def particle_forward(variant: Variant) -> SimpleNamespace:
    """Warp functions over particle p of all: `begin` a run of substeps, `advance` to the next slot and begin from there."""
    part, t, World = forward(variant), common(variant.real), world_of(variant.real, variant.bordered).World
    p2g, g2p, check, load, store, material_of = part.p2g, part.g2p, part.check, t.load, t.store, t.material_of
    anchor_of, Anchor = t.anchor_of, t.Anchor
    tell = approach(variant.real, variant.anchored).tell if variant.planes else None

    @wp.func
    def begin(p: int, lattice: t.Lattice, slot: int, world: World, states: t.States, momentum: wp.array(dtype=t.vec4)):
        particle, material, anchor = load(states, slot, p), material_of(world.materials, p), Anchor()
        if wp.static(variant.anchored):
            anchor = anchor_of(world.materials, p)
        p2g(lattice, particle, material, anchor, world.materials.node_force, momentum)
        if wp.static(tell is not None):
            tell(lattice, particle, anchor, material.volume, world.borders)  # type: ignore[misc]

    @wp.func
    def advance(
        p: int,
        lattice: t.Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        ends: bool,
        at: int,
        world: World,
        velocity: wp.array(dtype=t.vec4),
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        flags: wp.array(dtype=wp.int64),
    ):
        material, anchor = material_of(world.materials, p), Anchor()
        if wp.static(variant.anchored):
            anchor = anchor_of(world.materials, p)
        after = g2p(lattice, load(states, slot, p), material, anchor, at, velocity)
        store(states, next_slot, p, after)
        check(p, world.particles, lattice, after, anchor, substep, flags)
        if not ends:
            p2g(lattice, after, material, anchor, world.materials.node_force, momentum)
            if wp.static(tell is not None):
                tell(lattice, after, anchor, material.volume, world.borders)  # type: ignore[misc]

    return SimpleNamespace(begin=begin, advance=advance)


@cache
def particle_adjoint(variant: Variant) -> SimpleNamespace:
    """Warp functions over particle p of all: `enter` a run of substeps from its end, `retreat` over p2g and the g2p before."""
    part, t, World = adjoint(variant), common(variant.real), world_of(variant.real, variant.bordered).World
    g2p_adjoint, p2g_adjoint = part.g2p_adjoint, part.p2g_adjoint
    load, store, material_of, put_material = t.load, t.store, t.material_of, t.put_material
    anchor_of, put_anchor, Anchor = t.anchor_of, t.put_anchor, t.Anchor
    tell_adjoint = approach(variant.real, variant.anchored).tell_adjoint if variant.planes else None

    @wp.func
    def enter(
        p: int,
        lattice: t.Lattice,
        slot: int,
        at: int,
        world: World,
        states: t.States,
        velocity: wp.array(dtype=t.vec4),
        bars: t.States,
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        before, after = load(states, slot, p), load(states, slot + 1, p)
        material, share = material_of(world.materials, p), material_of(world_bar.materials, p)
        anchor, of_anchor = Anchor(), Anchor()
        if wp.static(variant.anchored):
            anchor = anchor_of(world.materials, p)
            of_anchor = anchor_of(world_bar.materials, p)
        bar = load(bars, 0, p)
        bar, share, of_anchor = g2p_adjoint(lattice, before, after, material, anchor, at, velocity, bar, share, of_anchor, velocity_bar)
        store(bars, 0, p, bar)
        put_material(world_bar.materials, p, share)
        if wp.static(variant.anchored):
            put_anchor(world_bar.materials, p, of_anchor)

    @wp.func
    def retreat(
        p: int,
        lattice: t.Lattice,
        slot: int,
        at: int,
        world: World,
        states: t.States,
        velocity: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        bars: t.States,
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        material, particle = material_of(world.materials, p), load(states, slot, p)
        force, force_bar = world.materials.node_force, world_bar.materials.node_force
        bar, share = load(bars, 0, p), material_of(world_bar.materials, p)
        anchor, of_anchor = Anchor(), Anchor()
        if wp.static(variant.anchored):
            anchor = anchor_of(world.materials, p)
            of_anchor = anchor_of(world_bar.materials, p)
        bar, share, of_anchor = p2g_adjoint(lattice, particle, material, anchor, force, momentum_bar, bar, share, of_anchor, force_bar)
        if wp.static(tell_adjoint is not None):
            x_bar, met_bar = tell_adjoint(lattice, particle, anchor, material.volume, world.borders, world_bar.borders)  # type: ignore[misc]
            bar.x = bar.x + x_bar
            of_anchor.x = of_anchor.x + met_bar
        if slot > 0:
            before = load(states, slot - 1, p)
            bar, share, of_anchor = g2p_adjoint(
                lattice, before, particle, material, anchor, at, velocity, bar, share, of_anchor, velocity_bar
            )
        store(bars, 0, p, bar)
        put_material(world_bar.materials, p, share)
        if wp.static(variant.anchored):
            put_anchor(world_bar.materials, p, of_anchor)

    return SimpleNamespace(enter=enter, retreat=retreat)


@cache
def serial_forward(variant: Variant) -> Any:
    """Kernel of one thread: `count` substeps of one simulation. With keep = 1 every state has its slot, and velocities
    start at slot * stride; with keep = 0 slots 0 and 1 take turns."""
    grid, part, t = forward(variant).grid, particle_forward(variant), common(variant.real)
    World, lattice_of = world_of(variant.real, variant.bordered).World, world_of(variant.real, variant.bordered).lattice_of
    begin, advance = part.begin, part.advance

    @kernel("serial_forward", variant)
    def run(
        # in:
        simulation: int,
        count: int,
        keep: int,
        stride: int,
        world: World,
        # out:
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        velocity: wp.array(dtype=t.vec4),
        flags: wp.array(dtype=wp.int64),
    ):
        lattice, drag = lattice_of(world, simulation), world.drag[simulation]
        first = simulation * world.particles
        for p in range(first, first + world.particles):
            begin(p, lattice, 0, world, states, momentum)
        for n in range(count):
            slot, next_slot = n, n + 1
            if keep == 0:
                slot, next_slot = n % 2, (n + 1) % 2
            ends, substep = n + 1 == count, world.start[0] + n
            for i in range(lattice.nx * lattice.ny * lattice.nz):
                grid(i, lattice, slot * stride, substep, drag, world.borders, momentum, velocity)
            for p in range(first, first + world.particles):
                advance(p, lattice, slot, next_slot, substep, ends, slot * stride, world, velocity, states, momentum, flags)

    return run


@cache
def serial_adjoint(variant: Variant) -> Any:
    """Kernel of one thread: back over the substeps of slots count - 1 .. 0 of one simulation; velocities are recomputed
    where stride = 0."""
    grid, grid_adjoint, t = forward(variant).grid, adjoint(variant).grid_adjoint, common(variant.real)
    World, lattice_of = world_of(variant.real, variant.bordered).World, world_of(variant.real, variant.bordered).lattice_of
    begin, part = particle_forward(variant).begin, particle_adjoint(variant)
    enter, retreat = part.enter, part.retreat

    @kernel("serial_adjoint", variant)
    def reverse(
        # in:
        simulation: int,
        count: int,
        stride: int,
        world: World,
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        velocity: wp.array(dtype=t.vec4),
        # out:
        bars: t.States,
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
    ):
        lattice, drag = lattice_of(world, simulation), world.drag[simulation]
        first = simulation * world.particles
        nodes = lattice.nx * lattice.ny * lattice.nz
        for back in range(count + 1):
            slot = count - back
            at = (slot - 1) * stride
            if slot < count:
                for i in range(nodes):
                    grid_adjoint(
                        i,
                        lattice,
                        slot * stride,
                        world.start[0] + slot,
                        drag,
                        world.borders,
                        velocity,
                        velocity_bar,
                        momentum_bar,
                        world_bar.drag,
                        world_bar.borders,
                    )
            if stride == 0 and slot > 0:
                for p in range(first, first + world.particles):
                    begin(p, lattice, slot - 1, world, states, momentum)
                for i in range(nodes):
                    grid(i, lattice, 0, world.start[0] + slot - 1, drag, world.borders, momentum, velocity)
            for p in range(first, first + world.particles):
                if slot == count:
                    enter(p, lattice, slot - 1, at, world, states, velocity, bars, world_bar, velocity_bar)
                else:
                    retreat(p, lattice, slot, at, world, states, velocity, momentum_bar, bars, world_bar, velocity_bar)

    return reverse


@cache
def parallel_forward(variant: Variant) -> SimpleNamespace:
    """Kernels begin and advance over particles, grid over (simulations, nodes of a box)."""
    grid_of, part, t = forward(variant).grid, particle_forward(variant), common(variant.real)
    World, lattice_of = world_of(variant.real, variant.bordered).World, world_of(variant.real, variant.bordered).lattice_of
    begin_of, advance_of = part.begin, part.advance
    of_module = kernel("parallel_forward", variant)

    @of_module
    def begin(slot: int, world: World, states: t.States, momentum: wp.array(dtype=t.vec4)):
        p = wp.tid()
        begin_of(p, lattice_of(world, p // world.particles), slot, world, states, momentum)

    @of_module
    def grid(at: int, n: int, room: int, world: World, momentum: wp.array(dtype=t.vec4), velocity: wp.array(dtype=t.vec4)):
        simulation, i = wp.tid()  # type: ignore[misc]
        lattice = lattice_of(world, simulation)
        lattice.base = simulation * room  # as in its box, but known before that is loaded; nodes past the box are empty
        grid_of(i, lattice, at, world.start[0] + n, world.drag[simulation], world.borders, momentum, velocity)

    @of_module
    def advance(
        slot: int,
        next_slot: int,
        n: int,
        ends: int,
        at: int,
        world: World,
        velocity: wp.array(dtype=t.vec4),
        states: t.States,
        momentum: wp.array(dtype=t.vec4),
        flags: wp.array(dtype=wp.int64),
    ):
        p = wp.tid()
        lattice = lattice_of(world, p // world.particles)
        substep = world.start[0] + n
        advance_of(p, lattice, slot, next_slot, substep, ends != 0, at, world, velocity, states, momentum, flags)

    return SimpleNamespace(begin=begin, grid=grid, advance=advance)


@cache
def parallel_adjoint(variant: Variant) -> SimpleNamespace:
    """Kernels enter and retreat over particles, grid_adjoint over (simulations, nodes of a box)."""
    grid_of, part, t = adjoint(variant).grid_adjoint, particle_adjoint(variant), common(variant.real)
    World, lattice_of = world_of(variant.real, variant.bordered).World, world_of(variant.real, variant.bordered).lattice_of
    enter_of, retreat_of = part.enter, part.retreat
    of_module = kernel("parallel_adjoint", variant)

    @of_module
    def enter(
        slot: int,
        at: int,
        world: World,
        states: t.States,
        velocity: wp.array(dtype=t.vec4),
        bars: t.States,
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        p = wp.tid()
        lattice = lattice_of(world, p // world.particles)
        enter_of(p, lattice, slot, at, world, states, velocity, bars, world_bar, velocity_bar)

    @of_module
    def grid_adjoint(
        at: int,
        n: int,
        room: int,
        world: World,
        velocity: wp.array(dtype=t.vec4),
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
    ):
        simulation, i = wp.tid()  # type: ignore[misc]
        lattice = lattice_of(world, simulation)
        lattice.base = simulation * room
        drag, substep = world.drag[simulation], world.start[0] + n
        grid_of(i, lattice, at, substep, drag, world.borders, velocity, velocity_bar, momentum_bar, world_bar.drag, world_bar.borders)

    @of_module
    def retreat(
        slot: int,
        at: int,
        world: World,
        states: t.States,
        velocity: wp.array(dtype=t.vec4),
        momentum_bar: wp.array(dtype=t.vec4),
        bars: t.States,
        world_bar: World,
        velocity_bar: wp.array(dtype=t.vec4),
    ):
        p = wp.tid()
        lattice = lattice_of(world, p // world.particles)
        retreat_of(p, lattice, slot, at, world, states, velocity, momentum_bar, bars, world_bar, velocity_bar)

    return SimpleNamespace(enter=enter, grid_adjoint=grid_adjoint, retreat=retreat)
