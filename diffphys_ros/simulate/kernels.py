"""The forward kernels of one substep: explicit MLS-MPM with APIC transfers (Hu et al. 2018; paper Eq. 6 and 7).

    p2g        particles -> momentum and mass of the nodes, elastic stress and forces included
    grid       nodal velocity, written from node `at` on: drag, Dirichlet nodes; empties the momentum grid for the next substep
    g2p        nodes -> particles: x, v, C, F of the next substep, and the flag of what went wrong

One source for CPU and CUDA, built once per law and scalar type. Stencil loops stay loops (`max_unroll` 0): the module
compiles in seconds and the compiler unrolls what pays. Nodes hold 4-vectors: momentum or velocity, and a scalar.
"""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from . import lanes, spline
from .laws import LAWS

LEFT_GRID, INVERTED, NON_FINITE = 0, 1, 2  # what a flag says: code = (substep * particles + particle) * 4 + reason

OPTIONS = {"enable_backward": False, "max_unroll": 3}


@cache
def common(real: type) -> SimpleNamespace:
    """Types and functions that forward and adjoint kernels share, over scalar type `real`."""
    vec3, vec4, mat33 = wp.types.vector(3, real), wp.types.vector(4, real), wp.types.matrix((3, 3), real)
    weights, slopes = spline.build(real)

    @wp.struct
    class Lattice:
        origin: vec3  # node (0, 0, 0) [m]
        dx: real  # [m]
        dt: real  # [s]
        affine: real  # 4 / dx^2 [1/m^2]: inverse of the quadratic spline's second moment
        empty_mass: real  # nodes lighter than this are empty [kg]
        nx: int
        ny: int
        nz: int
        clamp_index: int  # nodes with i <= clamp_index are held

    @wp.func
    def cell(lattice: Lattice, x: vec3):
        return (x - lattice.origin) / lattice.dx

    @wp.func
    def inside(lattice: Lattice, u: vec3):
        low = wp.min(u[0], wp.min(u[1], u[2])) >= real(0.5)
        high = u[0] < real(lattice.nx) - real(1.5) and u[1] < real(lattice.ny) - real(1.5) and u[2] < real(lattice.nz) - real(1.5)
        return low and high

    @wp.func
    def first(u: vec3):
        return wp.vec3i(int(wp.floor(u[0] - real(0.5))), int(wp.floor(u[1] - real(0.5))), int(wp.floor(u[2] - real(0.5))))

    @wp.func
    def lift(a: vec3, w: real):
        return vec4(a[0], a[1], a[2], w)

    @wp.func
    def column(A: mat33, j: int):
        return vec4(A[0, j], A[1, j], A[2, j], real(0.0))

    return SimpleNamespace(**locals(), **vars(lanes.build(real)))


def name(pass_: str, law: str, real: type, nodal: bool) -> str:
    """Name of a Warp module, which names its files in the kernel cache."""
    return f"{pass_}_{law}_{real.__name__}" + ("_nodal" if nodal else "")


@cache
def forward(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Kernels p2g, grid, g2p for a law's name and a Warp scalar type; `nodal`: a force density on the nodes acts too."""
    stress, _ = LAWS[law](real)
    module = wp.get_module(f"diffphys_ros.simulate.{name('forward', law, real, nodal)}")
    module.options |= OPTIONS
    kernel: Callable[..., Any] = wp.kernel(enable_backward=False, module=module)
    t = common(real)
    vec3, vec4, mat33, Lattice = t.vec3, t.vec4, t.mat33, t.Lattice
    cell, inside, first, lift, column, weights = t.cell, t.inside, t.first, t.lift, t.column, t.weights
    scaled, madd, gather, scatter = t.scaled, t.madd, t.gather, t.scatter

    @kernel
    def p2g(
        # in:
        lattice: Lattice,
        slot: int,
        xs: wp.array2d(dtype=vec3),
        vs: wp.array2d(dtype=vec3),
        Cs: wp.array2d(dtype=mat33),
        Fs: wp.array2d(dtype=mat33),
        mu: wp.array(dtype=real),
        lam: wp.array(dtype=real),
        body: wp.array(dtype=vec3),
        volume: wp.array(dtype=real),
        mass: wp.array(dtype=real),
        node_force: wp.array(dtype=vec3),
        # out:
        momentum: wp.array(dtype=vec4),
    ):
        p = wp.tid()
        u = cell(lattice, xs[slot, p])
        if not inside(lattice, u):
            return
        o = first(u)
        f = u - vec3(real(o[0]), real(o[1]), real(o[2]))
        step = vec3(real(0.0), real(1.0), real(2.0))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        A = mass[p] * Cs[slot, p] - (lattice.affine * lattice.dt * volume[p]) * stress(Fs[slot, p], mu[p], lam[p])
        A = lattice.dx * A
        b = lift(mass[p] * vs[slot, p] + (lattice.dt * volume[p]) * body[p], mass[p])
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        for i in range(3):
            bi = madd(madd(b, step[i] - f[0], ax), -f[2], az)
            for j in range(3):
                n = ((o[0] + i) * lattice.ny + o[1] + j) * lattice.nz + o[2]
                w = wx[i] * wy[j]
                h = madd(bi, step[j] - f[1], ay)
                scatter(momentum, n, w * wz[0], h)
                scatter(momentum, n + 1, w * wz[1], madd(h, real(1.0), az))
                scatter(momentum, n + 2, w * wz[2], madd(h, real(2.0), az))
                if wp.static(nodal):
                    impulse = w * lattice.dt * volume[p]
                    for k in range(3):
                        wp.atomic_add(momentum, n + k, lift((impulse * wz[k]) * node_force[n + k], real(0.0)))

    @kernel
    def grid(
        # in:
        lattice: Lattice,
        at: int,
        keep: wp.array(dtype=real),
        # out:
        momentum: wp.array(dtype=vec4),
        velocity: wp.array(dtype=vec4),
    ):
        n = wp.tid()
        q = momentum[n]
        if q[3] == real(0.0):
            return
        momentum[n] = vec4()
        if n < (lattice.clamp_index + 1) * lattice.ny * lattice.nz or q[3] <= lattice.empty_mass:
            velocity[at + n] = vec4()
        else:
            scale = keep[0] / q[3]
            velocity[at + n] = vec4(scale * q[0], scale * q[1], scale * q[2], scale)

    @kernel
    def g2p(
        # in:
        lattice: Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        at: int,
        velocity: wp.array(dtype=vec4),
        # out:
        xs: wp.array2d(dtype=vec3),
        vs: wp.array2d(dtype=vec3),
        Cs: wp.array2d(dtype=mat33),
        Fs: wp.array2d(dtype=mat33),
        flag: wp.array(dtype=wp.int64),
    ):
        p = wp.tid()
        x = xs[slot, p]
        u = cell(lattice, x)
        if not inside(lattice, u):
            return
        o = first(u)
        f = u - vec3(real(o[0]), real(o[1]), real(o[2]))
        step = vec3(real(0.0), real(1.0), real(2.0))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        v = vec4()
        bx = vec4()
        by = vec4()
        bz = vec4()
        for i in range(3):
            for j in range(3):
                n = at + ((o[0] + i) * lattice.ny + o[1] + j) * lattice.nz + o[2]
                g1 = scaled(wz[1], gather(velocity, n + 1))
                g2 = scaled(wz[2], gather(velocity, n + 2))
                w = wx[i] * wy[j]
                s = scaled(w, madd(madd(g1, wz[0], gather(velocity, n)), real(1.0), g2))
                v = madd(v, real(1.0), s)
                bx = madd(bx, step[i] - f[0], s)
                by = madd(by, step[j] - f[1], s)
                bz = madd(bz, w, madd(g1, real(2.0), g2))
        bz -= f[2] * v
        C = (lattice.affine * lattice.dx) * mat33(bx[0], by[0], bz[0], bx[1], by[1], bz[1], bx[2], by[2], bz[2])
        v3 = vec3(v[0], v[1], v[2])
        F = Fs[slot, p]
        F = F + lattice.dt * (C * F)
        x = x + lattice.dt * v3
        xs[next_slot, p] = x
        vs[next_slot, p] = v3
        Cs[next_slot, p] = C
        Fs[next_slot, p] = F
        ratio = wp.determinant(F)
        if not (inside(lattice, cell(lattice, x)) and ratio > real(0.0) and wp.isfinite(ratio)):
            reason = wp.int64(LEFT_GRID)
            if ratio <= real(0.0):
                reason = wp.int64(INVERTED)
            if not wp.isfinite(wp.length_sq(x) + ratio):
                reason = wp.int64(NON_FINITE)
            particles = wp.int64(xs.shape[1])
            wp.atomic_min(flag, 0, (wp.int64(substep) * particles + wp.int64(p)) * wp.int64(4) + reason)

    return SimpleNamespace(p2g=p2g, grid=grid, g2p=g2p, Lattice=Lattice)
