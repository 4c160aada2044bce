"""Warp functions of planes and handle: a node's velocity between the division by mass and g2p, and the adjoint of that."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .borders import EDGE, KINDS
from .common import common

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

STICKY, SLIP, SEPARATE = range(len(KINDS))


@cache
def contact(real: type, bordered: bool) -> SimpleNamespace:
    """The struct Borders, and the functions meet and meet_adjoint; all three are empty where nothing borders the body."""
    return _met(real) if bordered else _free(real)


def _free(real: type) -> SimpleNamespace:
    t = common(real)
    vec3, Lattice = t.vec3, t.Lattice

    @wp.struct
    class NoBorders:
        none: int

    @wp.func
    def meet(lattice: Lattice, borders: NoBorders, substep: int, n: int, v: vec3):
        return v

    return SimpleNamespace(Borders=NoBorders, meet=meet, meet_adjoint=None)


def _met(real: type) -> SimpleNamespace:
    t = common(real)
    vec3, vec4, Lattice = t.vec3, t.vec4, t.Lattice
    mat34 = wp.types.matrix((3, 4), real)
    stick, separate = wp.constant(STICKY), wp.constant(SEPARATE)
    edge = wp.constant(real(EDGE))

    @wp.struct
    class Borders:
        normal: wp.array(dtype=vec3)  # of each plane, unit
        offset: wp.array(dtype=real)  # [m]
        kind: wp.array(dtype=int)  # index in KINDS
        friction: wp.array2d(dtype=real)  # of each simulation's planes
        low: vec3  # of the handle's box, in its frame [m]; empty where there is no handle
        high: vec3
        motion: wp.array2d(dtype=mat34)  # of each simulation's handle in each substep: velocity = motion (x, 1) [1/s, m/s]
        handle_from_body: wp.array2d(dtype=mat34)  # at each substep

    @wp.func
    def place(lattice: Lattice, n: int):
        k = n % lattice.nz
        ij = n // lattice.nz
        return lattice.origin + lattice.dx * vec3(real(ij // lattice.ny), real(ij % lattice.ny), real(k))

    @wp.func
    def below(borders: Borders, plane: int, x: vec3, slack: real):
        return wp.dot(borders.normal[plane], x) <= borders.offset[plane] + slack

    @wp.func
    def held(borders: Borders, simulation: int, substep: int, x: vec3, slack: real):
        y = borders.handle_from_body[simulation, substep] * vec4(x[0], x[1], x[2], real(1.0))
        over = wp.max(borders.low - y, y - borders.high)
        return wp.max(over[0], wp.max(over[1], over[2])) <= slack

    @wp.func
    def bounce(v: vec3, normal: vec3, kind: int, friction: real):
        """Velocity that a plane leaves of v."""
        into = wp.dot(normal, v)
        if kind == stick:
            return vec3()
        if kind == separate and into >= real(0.0):
            return v
        along = v - into * normal
        speed = wp.length(along)
        if into >= real(0.0) or friction == real(0.0):
            return along
        left = speed + friction * into
        if left <= real(0.0):
            return vec3()
        return (left / speed) * along

    @wp.func
    def bounce_adjoint(v: vec3, normal: vec3, kind: int, friction: real, bar: vec3):
        """(v_bar, friction_bar) of bounce; at the kinks the derivative of the branch that bounce takes."""
        zero = real(0.0)
        into = wp.dot(normal, v)
        if kind == stick:
            return vec3(), zero
        if kind == separate and into >= zero:
            return bar, zero
        along = v - into * normal
        speed = wp.length(along)
        flat_bar = bar - wp.dot(normal, bar) * normal
        if into >= zero or friction == zero:
            slope = zero
            if into < zero and speed > zero:
                slope = into * wp.dot(along, bar) / speed
            return flat_bar, slope
        left = speed + friction * into
        if left <= zero:
            return vec3(), zero
        way = along / speed
        share = wp.dot(way, bar)
        return (left / speed) * (flat_bar - share * way) + share * way + (friction * share) * normal, into * share

    @wp.func
    def after_planes(borders: Borders, simulation: int, count: int, x: vec3, slack: real, v: vec3):
        """Velocity that the first `count` planes leave of v."""
        for plane in range(count):
            if below(borders, plane, x, slack):
                v = bounce(v, borders.normal[plane], borders.kind[plane], borders.friction[simulation, plane])
        return v

    @wp.func
    def meet(lattice: Lattice, borders: Borders, substep: int, n: int, v: vec3):
        """Velocity of node n after the handle, or after the planes in order."""
        x = place(lattice, n)
        slack = edge * lattice.dx
        if held(borders, lattice.simulation, substep, x, slack):
            return borders.motion[lattice.simulation, substep] * vec4(x[0], x[1], x[2], real(1.0))
        return after_planes(borders, lattice.simulation, borders.normal.shape[0], x, slack, v)

    @wp.func
    def meet_adjoint(
        lattice: Lattice,
        borders: Borders,
        substep: int,
        n: int,
        free: vec3,
        bar: vec3,
        borders_bar: Borders,
    ):
        """Adjoint of the velocity `free` that node n had before; those of friction and motion are added up."""
        x = place(lattice, n)
        slack = edge * lattice.dx
        if held(borders, lattice.simulation, substep, x, slack):
            wp.atomic_add(borders_bar.motion, lattice.simulation, substep, wp.outer(bar, vec4(x[0], x[1], x[2], real(1.0))))
            return vec3()
        planes = borders.normal.shape[0]
        for back in range(planes):
            plane = planes - 1 - back
            if below(borders, plane, x, slack):
                v = after_planes(borders, lattice.simulation, plane, x, slack, free)
                bar, slope = bounce_adjoint(v, borders.normal[plane], borders.kind[plane], borders.friction[lattice.simulation, plane], bar)
                if slope != real(0.0):
                    wp.atomic_add(borders_bar.friction, lattice.simulation, plane, slope)
        return bar

    return SimpleNamespace(Borders=Borders, mat34=mat34, meet=meet, meet_adjoint=meet_adjoint)
