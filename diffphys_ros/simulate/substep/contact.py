"""Warp functions of planes and handle: a node's velocity between the division by mass and g2p, and the adjoint of that."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..borders import EDGE, KINDS
from .common import common

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,index,operator,valid-type"

STICKY, SLIP, SEPARATE = range(len(KINDS))
LANDING = 4.0  # substeps in which a body would cover what is left of its way to a plane: the blow is spread over a few


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
    def meet(lattice: Lattice, borders: NoBorders, substep: int, n: int, v: vec3, nodes: wp.array(dtype=t.vec4), near: int):
        return v

    return SimpleNamespace(Borders=NoBorders, meet=meet, meet_adjoint=None)


def _met(real: type) -> SimpleNamespace:
    t = common(real)
    vec3, vec4, Lattice = t.vec3, t.vec4, t.Lattice
    mat34 = wp.types.matrix((3, 4), real)
    stick, separate = wp.constant(STICKY), wp.constant(SEPARATE)
    edge, landing = wp.constant(real(EDGE)), wp.constant(real(LANDING))

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
        near: wp.array(dtype=vec4)  # sums of plane_distance.py for each plane of each node
        anchored: int  # not 0: nodes stand where the motion started, and what is near says how high they are by now

    @wp.func
    def place(lattice: Lattice, n: int):
        k = n % lattice.nz
        ij = n // lattice.nz
        return lattice.origin + lattice.dx * (lattice.low + vec3(real(ij // lattice.ny), real(ij % lattice.ny), real(k)))

    @wp.func
    def meets(lattice: Lattice, borders: Borders, plane: int, x: vec3, near: vec4):
        """Whether a node at x lies at or below a plane; or where the plane lets go: not far above it, and material near it."""
        above = (wp.dot(borders.normal[plane], x) - borders.offset[plane]) / lattice.dx
        if borders.kind[plane] == separate:
            if near[0] <= real(0.0):
                return False
            if borders.anchored != 0:
                above = near[2] / (near[0] * lattice.dx)
            return above <= real(0.5)
        return above <= edge

    @wp.func
    def held(lattice: Lattice, borders: Borders, substep: int, x: vec3):
        """Whether the handle's box holds a node at x."""
        y = borders.handle_from_body[lattice.simulation, substep] * vec4(x[0], x[1], x[2], real(1.0))
        over = wp.max(borders.low - y, y - borders.high)
        return wp.max(over[0], wp.max(over[1], over[2])) <= edge * lattice.dx

    @wp.func
    def reach(near: vec4):
        """Distance that material near a node still has to a plane [m], from sums as in approach.py; 0 where it touches."""
        return wp.max(near[1] / near[0], real(0.0))

    @wp.func
    def bounce(v: vec3, normal: vec3, kind: int, friction: real, ahead: real):
        """Velocity that a plane leaves of v; `ahead` [m/s] is how fast material may approach a separate one without passing it."""
        into = wp.dot(normal, v) + ahead
        if kind == stick:
            return vec3()
        if kind == separate and into >= real(0.0):
            return v
        along = v - wp.dot(normal, v) * normal
        left = wp.length(along)  # type: ignore[call-overload]
        if into < real(0.0) and friction > real(0.0):
            share = wp.max(left + friction * into, real(0.0))
            if share == real(0.0):
                along = vec3()
            else:
                along = (share / left) * along
        return along - ahead * normal

    @wp.func
    def bounce_adjoint(v: vec3, normal: vec3, kind: int, friction: real, ahead: real, bar: vec3):
        """(v_bar, friction_bar, ahead_bar) of bounce; at the kinks the derivative of the branch that bounce takes."""
        zero = real(0.0)
        into = wp.dot(normal, v) + ahead
        if kind == stick:
            return vec3(), zero, zero
        if kind == separate and into >= zero:
            return bar, zero, zero
        along = v - wp.dot(normal, v) * normal
        speed = wp.length(along)  # type: ignore[call-overload]
        normal_bar = wp.dot(normal, bar)
        flat_bar = bar - normal_bar * normal
        if into >= zero or speed == zero:
            if into < zero and friction > zero:
                flat_bar = vec3()
            return flat_bar, zero, -normal_bar
        left = speed + friction * into
        if left <= zero:
            return vec3(), zero, -normal_bar
        way = along / speed
        share = wp.dot(way, bar)
        flat_bar = (left / speed) * (flat_bar - share * way) + share * way
        return flat_bar + (friction * share) * normal, into * share, friction * share - normal_bar

    @wp.func
    def ahead_of(kind: int, near: vec4, dt: real):
        """How fast material near a node may still approach a plane [m/s]."""
        if kind == separate:
            return reach(near) / (landing * dt)
        return real(0.0)

    @wp.func
    def after_planes(lattice: Lattice, borders: Borders, count: int, x: vec3, v: vec3, nodes: wp.array(dtype=vec4), near: int):
        """Velocity that the first `count` planes leave of v at a node at x, whose sums start at nodes[near]."""
        for plane in range(count):
            if meets(lattice, borders, plane, x, nodes[near + plane]):
                kind = borders.kind[plane]
                ahead = ahead_of(kind, nodes[near + plane], lattice.dt)
                v = bounce(v, borders.normal[plane], kind, borders.friction[lattice.simulation, plane], ahead)
        return v

    @wp.func
    def meet(lattice: Lattice, borders: Borders, substep: int, n: int, v: vec3, nodes: wp.array(dtype=vec4), near: int):
        """Velocity of node n after the handle, or after the planes in order."""
        x = place(lattice, n)
        if held(lattice, borders, substep, x):
            return borders.motion[lattice.simulation, substep] * vec4(x[0], x[1], x[2], real(1.0))
        return after_planes(lattice, borders, borders.normal.shape[0], x, v, nodes, near)

    @wp.func
    def meet_adjoint(
        lattice: Lattice,
        borders: Borders,
        substep: int,
        n: int,
        free: vec3,
        bar: vec3,
        nodes: wp.array(dtype=vec4),
        near: int,
        borders_bar: Borders,
    ):
        """Adjoint of the velocity `free` that node n had before; those of friction and motion are added up, those of the
        node's sums written."""
        x = place(lattice, n)
        if held(lattice, borders, substep, x):
            wp.atomic_add(borders_bar.motion, lattice.simulation, substep, wp.outer(bar, vec4(x[0], x[1], x[2], real(1.0))))
            return vec3()
        planes = borders.normal.shape[0]
        for back in range(planes):
            plane = planes - 1 - back
            sums = nodes[near + plane]
            if meets(lattice, borders, plane, x, sums):
                v = after_planes(lattice, borders, plane, x, free, nodes, near)
                kind, friction = borders.kind[plane], borders.friction[lattice.simulation, plane]
                ahead = ahead_of(kind, sums, lattice.dt)
                bar, friction_bar, ahead_bar = bounce_adjoint(v, borders.normal[plane], kind, friction, ahead, bar)
                if friction_bar != real(0.0):
                    wp.atomic_add(borders_bar.friction, lattice.simulation, plane, friction_bar)
                if ahead > real(0.0):
                    reach_bar = ahead_bar / (landing * lattice.dt * sums[0])
                    borders_bar.near[(lattice.base + n) * planes + plane] = vec4(-reach(sums) * reach_bar, reach_bar, real(0.0), real(0.0))
        return bar

    return SimpleNamespace(Borders=Borders, mat34=mat34, meet=meet, meet_adjoint=meet_adjoint, separate=separate)
