"""Transfer between a particle and the 27 nodes around it: the one loop over the quadratic B-spline stencil.

With d_i the distance of node i from the particle in cells, w_i its weight and h_i = b + A d_i an affine field, a transfer
does any of the following in one pass over the nodes' 4-vectors:

    scatters   adds w_i h_i to the nodes `into`
    gathers    returns the moments sum_i w_i V_i (1, d_i) of the nodes V
    slopes     returns sum_i (V_i . h_i) grad w_i, the part of the derivative of sum_i w_i V_i . h_i with respect to the
               particle's position in cells that runs over the weights; the rest is -A^T sum_i w_i V_i

p2g scatters, g2p gathers; the adjoint of g2p scatters and slopes, that of p2g gathers and slopes. With `loaded`, h_i has
a term c load_i more, c being the particle's factor and load a vector on the nodes; its adjoint is added up where moments
are gathered.
"""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .common import common

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,index,valid-type"


@cache
def stencil(real: type) -> SimpleNamespace:
    """The structs Stencil and Load; `around(lattice, u)`, the stencil of a point u in cells; weight and slope along an axis."""
    t = common(real)
    vec3, Lattice = t.vec3, t.Lattice

    @wp.struct
    class Stencil:
        first: int  # flat index of node (0, 0, 0) of the 27
        ny: int
        nz: int
        f: vec3  # distance of the point from that node [cells], 0.5 .. 1.5

    @wp.struct
    class Load:  # a vector on the nodes, with its factor at this particle
        factor: real
        force: wp.array(dtype=vec3)
        bar: wp.array(dtype=vec3)

    @wp.func
    def start(u: real, nodes: int):
        """First of three nodes; kept in the box for points that are not, whose frame is thrown away."""
        return wp.max(wp.min(int(wp.floor(u - real(0.5))), nodes - 3), 0)

    @wp.func
    def around(lattice: Lattice, u: vec3):
        i, j, k = start(u[0], lattice.nx), start(u[1], lattice.ny), start(u[2], lattice.nz)
        first = lattice.base + (i * lattice.ny + j) * lattice.nz + k
        return Stencil(first, lattice.ny, lattice.nz, u - vec3(real(i), real(j), real(k)))  # type: ignore[call-arg]

    @wp.func
    def weight(f: real, k: int):
        b = f - real(1.0)
        if k == 1:
            return real(0.75) - b * b
        a = real(1.5) - f
        if k == 2:
            a = f - real(0.5)
        return real(0.5) * a * a

    @wp.func
    def slope(f: real, k: int):
        if k == 1:
            return real(2.0) - real(2.0) * f
        if k == 2:
            return f - real(0.5)
        return f - real(1.5)

    return SimpleNamespace(Stencil=Stencil, Load=Load, around=around, weight=weight, slope=slope)


@cache
def transfer(
    real: type, *, scatters: bool = False, gathers: bool = False, slopes: bool = False, loaded: bool = False, pitch: int = 1
) -> Any:
    """Warp function (stencil, field, nodes, at, into, load) -> (moments, slope); `nodes` are read from index `at` on,
    every `pitch`-th of them.

    The stencil is unrolled along k by hand: what is affine in k costs one addition."""
    t, s = common(real), stencil(real)
    vec3, vec4, Affine, Stencil, Load = t.vec3, t.vec4, t.Affine, s.Stencil, s.Load
    weight, slope_of, scaled, madd, madd_each = s.weight, s.slope, t.scaled, t.madd, t.madd_each
    get, scatter, lift, lower = t.get, t.scatter, t.lift, t.lower
    reads = gathers or slopes

    @wp.func
    def total(a: vec4):
        return a[0] + a[1] + a[2] + a[3]

    @wp.func
    def visit(stencil: Stencil, field: Affine, nodes: wp.array(dtype=vec4), at: int, into: wp.array(dtype=vec4), load: Load):
        f = stencil.f
        wz0, wz1, wz2 = weight(f[2], 0), weight(f[2], 1), weight(f[2], 2)
        one, two = real(1.0), real(2.0)
        step = vec3(real(0.0), one, two)
        moments = Affine()
        gx, gy, gz = vec4(), vec4(), vec4()
        for i in range(3):
            wx, dx = weight(f[0], i), step[i] - f[0]
            hi = madd(madd(field.b, dx, field.x), -f[2], field.z)
            for j in range(3):
                wy, dy = weight(f[1], j), step[j] - f[1]
                n = stencil.first + (i * stencil.ny + j) * stencil.nz
                w = wx * wy
                h0 = madd(hi, dy, field.y)
                h1 = madd(h0, one, field.z)
                h2 = madd(h0, two, field.z)
                if wp.static(loaded):
                    h0 = h0 + lift(load.factor * load.force[n], real(0.0))
                    h1 = h1 + lift(load.factor * load.force[n + 1], real(0.0))
                    h2 = h2 + lift(load.factor * load.force[n + 2], real(0.0))
                if wp.static(reads):
                    v0 = get(nodes, at + pitch * n)
                    v1 = get(nodes, at + pitch * (n + 1))
                    v2 = get(nodes, at + pitch * (n + 2))
                if wp.static(scatters):
                    scatter(into, n, w * wz0, h0)
                    scatter(into, n + 1, w * wz1, h1)
                    scatter(into, n + 2, w * wz2, h2)
                if wp.static(slopes):
                    e0 = madd_each(vec4(), v0, h0)
                    e1 = madd_each(vec4(), v1, h1)
                    e2 = madd_each(vec4(), v2, h2)
                    e = madd(madd(scaled(wz0, e0), wz1, e1), wz2, e2)
                    gx = madd(gx, slope_of(f[0], i) * wy, e)
                    gy = madd(gy, wx * slope_of(f[1], j), e)
                    ez = madd(madd(scaled(slope_of(f[2], 0), e0), slope_of(f[2], 1), e1), slope_of(f[2], 2), e2)
                    gz = madd(gz, w, ez)
                if wp.static(gathers):
                    u1 = scaled(wz1, v1)
                    u2 = scaled(wz2, v2)
                    m = scaled(w, madd(madd(u1, wz0, v0), one, u2))
                    moments.b = madd(moments.b, one, m)
                    moments.x = madd(moments.x, dx, m)
                    moments.y = madd(moments.y, dy, m)
                    moments.z = madd(moments.z, w, madd(u1, two, u2))
                if wp.static(gathers and loaded):
                    wp.atomic_add(load.bar, n, (load.factor * w * wz0) * lower(v0))
                    wp.atomic_add(load.bar, n + 1, (load.factor * w * wz1) * lower(v1))
                    wp.atomic_add(load.bar, n + 2, (load.factor * w * wz2) * lower(v2))
        moments.z = madd(moments.z, -f[2], moments.b)
        slope = vec3()
        if wp.static(slopes):
            slope = vec3(total(gx), total(gy), total(gz))
        return moments, slope

    return visit
