"""The adjoint of one substep, by hand: the derivative of kernels.py read backwards.

    g2p_adjoint    adjoints of the next state -> adjoint of the nodal velocity, parts of the adjoints of x and F
    grid_adjoint   adjoint of the nodal velocity -> adjoint of momentum and mass, of the drag factor
    p2g_adjoint    adjoint of momentum and mass -> adjoints of the state, of mu, lam, body force and mass

The state before and after the substep and the nodal velocity between them must be at hand (the replay provides them).
With L = sum_i w_i(x) V_i . (a + Q d_i), d_i = x_i - x, both transfers have the position gradient
sum_i (V_i . (a + Q d_i)) grad w_i - Q^T sum_i w_i V_i: the same loop serves twice. Names end in _bar for dL/d(name).
"""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from .kernels import OPTIONS, common, name
from .laws import LAWS


@cache
def adjoint(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Kernels g2p_adjoint, grid_adjoint, p2g_adjoint; arguments as for kernels.forward."""
    stress, stress_adjoint = LAWS[law](real)
    module = wp.get_module(f"diffphys_ros.simulate.{name('adjoint', law, real, nodal)}")
    module.options |= OPTIONS
    kernel: Callable[..., Any] = wp.kernel(enable_backward=False, module=module)
    t = common(real)
    vec3, vec4, mat33, Lattice = t.vec3, t.vec4, t.mat33, t.Lattice
    cell, inside, first, lift, column, weights, slopes = t.cell, t.inside, t.first, t.lift, t.column, t.weights, t.slopes
    scaled, madd, madd_each, gather, scatter = t.scaled, t.madd, t.madd_each, t.gather, t.scatter

    @wp.func
    def total(a: vec4):
        return a[0] + a[1] + a[2] + a[3]

    @kernel
    def g2p_adjoint(
        # in:
        lattice: Lattice,
        slot: int,
        next_slot: int,
        at: int,
        xs: wp.array2d(dtype=vec3),
        vs: wp.array2d(dtype=vec3),
        Cs: wp.array2d(dtype=mat33),
        Fs: wp.array2d(dtype=mat33),
        velocity: wp.array(dtype=vec4),
        v_bar: wp.array(dtype=vec3),
        C_bar: wp.array(dtype=mat33),
        # out:
        x_bar: wp.array(dtype=vec3),
        F_bar: wp.array(dtype=mat33),
        velocity_bar: wp.array(dtype=vec4),
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
        sx = slopes(f[0])
        sy = slopes(f[1])
        sz = slopes(f[2])
        next_F_bar = F_bar[p]
        Q = (lattice.affine * lattice.dx) * (C_bar[p] + lattice.dt * (next_F_bar * wp.transpose(Fs[slot, p])))
        a = lift(v_bar[p] + lattice.dt * x_bar[p], real(0.0))
        qx = column(Q, 0)
        qy = column(Q, 1)
        qz = column(Q, 2)
        gx = vec4()
        gy = vec4()
        gz = vec4()
        for i in range(3):
            ai = madd(madd(a, step[i] - f[0], qx), -f[2], qz)
            for j in range(3):
                n = ((o[0] + i) * lattice.ny + o[1] + j) * lattice.nz + o[2]
                q0 = madd(ai, step[j] - f[1], qy)
                q1 = madd(q0, real(1.0), qz)
                q2 = madd(q0, real(2.0), qz)
                w = wx[i] * wy[j]
                v0 = gather(velocity, at + n)
                v1 = gather(velocity, at + n + 1)
                v2 = gather(velocity, at + n + 2)
                scatter(velocity_bar, n, w * wz[0], q0)
                scatter(velocity_bar, n + 1, w * wz[1], q1)
                scatter(velocity_bar, n + 2, w * wz[2], q2)
                e0 = madd_each(vec4(), v0, q0)
                e1 = madd_each(vec4(), v1, q1)
                e2 = madd_each(vec4(), v2, q2)
                e = madd(madd(scaled(wz[0], e0), wz[1], e1), wz[2], e2)
                gx = madd(gx, sx[i] * wy[j], e)
                gy = madd(gy, wx[i] * sy[j], e)
                gz = madd(gz, w, madd(madd(scaled(sz[0], e0), sz[1], e1), sz[2], e2))
        slope = vec3(total(gx), total(gy), total(gz))
        x_bar[p] = x_bar[p] + (slope - wp.transpose(Q) * vs[next_slot, p]) / lattice.dx
        F_bar[p] = next_F_bar + lattice.dt * (wp.transpose(Cs[next_slot, p]) * next_F_bar)

    @kernel
    def grid_adjoint(
        # in:
        at: int,
        keep: wp.array(dtype=real),
        velocity: wp.array(dtype=vec4),
        # out:
        velocity_bar: wp.array(dtype=vec4),
        momentum_bar: wp.array(dtype=vec4),
        keep_bar: wp.array(dtype=real),
    ):
        n = wp.tid()
        b = velocity_bar[n]
        if b[0] == real(0.0) and b[1] == real(0.0) and b[2] == real(0.0):
            momentum_bar[n] = vec4()
            return
        velocity_bar[n] = vec4()
        v = velocity[at + n]
        scale = v[3]
        along = (b[0] * v[0] + b[1] * v[1] + b[2] * v[2]) / keep[0]
        momentum_bar[n] = vec4(scale * b[0], scale * b[1], scale * b[2], -scale * along)
        keep_bar[n] = keep_bar[n] + along

    @kernel
    def p2g_adjoint(
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
        momentum_bar: wp.array(dtype=vec4),
        # out:
        x_bar: wp.array(dtype=vec3),
        v_bar: wp.array(dtype=vec3),
        C_bar: wp.array(dtype=mat33),
        F_bar: wp.array(dtype=mat33),
        mu_bar: wp.array(dtype=real),
        lam_bar: wp.array(dtype=real),
        body_bar: wp.array(dtype=vec3),
        mass_bar: wp.array(dtype=real),
        node_force_bar: wp.array(dtype=vec3),
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
        sx = slopes(f[0])
        sy = slopes(f[1])
        sz = slopes(f[2])
        m = mass[p]
        F = Fs[slot, p]
        C = Cs[slot, p]
        v = vs[slot, p]
        stiff = lattice.affine * lattice.dt * volume[p]
        A = lattice.dx * (m * C - stiff * stress(F, mu[p], lam[p]))
        b = lift(m * v + (lattice.dt * volume[p]) * body[p], m)
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        received = vec4()
        tx = vec4()
        ty = vec4()
        tz = vec4()
        gx = vec4()
        gy = vec4()
        gz = vec4()
        for i in range(3):
            bi = madd(madd(b, step[i] - f[0], ax), -f[2], az)
            for j in range(3):
                n = ((o[0] + i) * lattice.ny + o[1] + j) * lattice.nz + o[2]
                h0 = madd(bi, step[j] - f[1], ay)
                g0 = gather(momentum_bar, n)
                g1 = gather(momentum_bar, n + 1)
                g2 = gather(momentum_bar, n + 2)
                e0 = madd_each(vec4(), g0, h0)
                e1 = madd_each(vec4(), g1, madd(h0, real(1.0), az))
                e2 = madd_each(vec4(), g2, madd(h0, real(2.0), az))
                w = wx[i] * wy[j]
                if wp.static(nodal):
                    impulse = lattice.dt * volume[p]
                    e0 = madd_each(e0, impulse * lift(node_force[n], real(0.0)), g0)
                    e1 = madd_each(e1, impulse * lift(node_force[n + 1], real(0.0)), g1)
                    e2 = madd_each(e2, impulse * lift(node_force[n + 2], real(0.0)), g2)
                    for k in range(3):
                        g = momentum_bar[n + k]
                        wp.atomic_add(node_force_bar, n + k, (impulse * w * wz[k]) * vec3(g[0], g[1], g[2]))
                e = madd(madd(scaled(wz[0], e0), wz[1], e1), wz[2], e2)
                gx = madd(gx, sx[i] * wy[j], e)
                gy = madd(gy, wx[i] * sy[j], e)
                gz = madd(gz, w, madd(madd(scaled(sz[0], e0), sz[1], e1), sz[2], e2))
                t = madd(scaled(wz[1], g1), real(2.0) * wz[2], g2)
                s = scaled(w, madd(madd(scaled(wz[0], g0), wz[1], g1), wz[2], g2))
                received = madd(received, real(1.0), s)
                tx = madd(tx, step[i] - f[0], s)
                ty = madd(ty, step[j] - f[1], s)
                tz = madd(tz, w, t)
        tz -= f[2] * received
        slope = vec3(total(gx), total(gy), total(gz))
        b_bar = vec3(received[0], received[1], received[2])
        A_bar = lattice.dx * mat33(tx[0], ty[0], tz[0], tx[1], ty[1], tz[1], tx[2], ty[2], tz[2])
        through_F, through_mu, through_lam = stress_adjoint(F, mu[p], lam[p], (-stiff) * A_bar)
        x_bar[p] = x_bar[p] + (slope - wp.transpose(A) * b_bar) / lattice.dx
        v_bar[p] = m * b_bar
        C_bar[p] = m * A_bar
        F_bar[p] = F_bar[p] + through_F
        mu_bar[p] = mu_bar[p] + through_mu
        lam_bar[p] = lam_bar[p] + through_lam
        body_bar[p] = body_bar[p] + (lattice.dt * volume[p]) * b_bar
        mass_bar[p] = mass_bar[p] + received[3] + wp.dot(b_bar, v) + wp.ddot(A_bar, C)

    return SimpleNamespace(g2p_adjoint=g2p_adjoint, grid_adjoint=grid_adjoint, p2g_adjoint=p2g_adjoint)
