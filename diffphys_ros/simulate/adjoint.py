"""The adjoint of one substep, by hand: the derivative of forward.py read backwards.

    g2p_adjoint    adjoints of a particle's next state -> adjoint of nodal velocities, parts of the adjoints of x and F
    grid_adjoint   adjoint of a node's velocity -> adjoints of its momentum and mass, and of the drag factor
    p2g_adjoint    adjoints of momentum and mass -> adjoints of a particle's state, mu, lam, body force and mass

The states before and after the substep and the nodal velocities between them must be at hand.
With L = sum_i w_i(x) V_i . (a + Q d_i), d_i = x_i - x, both transfers have the position gradient
sum_i (V_i . (a + Q d_i)) grad w_i - Q^T sum_i w_i V_i: the same loop serves twice. Names end in _bar for dL/d(name).
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .common import common
from .laws import LAWS

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors


@cache
def adjoint(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Warp functions g2p_adjoint, grid_adjoint, p2g_adjoint; arguments as for forward.forward."""
    stress, stress_adjoint = LAWS[law](real)
    t = common(real)
    vec3, vec4, mat33, Lattice, States, Material, StateBar = t.vec3, t.vec4, t.mat33, t.Lattice, t.States, t.Material, t.StateBar
    cell, inside, first, past, node, lift, column, weights, slopes = (
        getattr(t, name) for name in ("cell", "inside", "first", "past", "node", "lift", "column", "weights", "slopes")
    )
    scaled, madd, madd_each, gather, scatter = t.scaled, t.madd, t.madd_each, t.gather, t.scatter

    @wp.func
    def total(a: vec4):
        return a[0] + a[1] + a[2] + a[3]

    @wp.func
    def g2p_adjoint(
        p: int,
        lattice: Lattice,
        slot: int,
        next_slot: int,
        at: int,
        states: States,
        velocity: wp.array(dtype=vec4),
        bar: StateBar,
        velocity_bar: wp.array(dtype=vec4),
    ):
        u = cell(lattice, states.x[slot, p])
        if not inside(lattice, u):
            return
        o = first(u)
        f = past(u, o)
        step = vec3(real(0.0), real(1.0), real(2.0))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        sx = slopes(f[0])
        sy = slopes(f[1])
        sz = slopes(f[2])
        F_bar = bar.F[p]
        Q = (lattice.affine * lattice.dx) * (bar.C[p] + lattice.dt * (F_bar * wp.transpose(states.F[slot, p])))
        a = lift(bar.v[p] + lattice.dt * bar.x[p], real(0.0))
        qx = column(Q, 0)
        qy = column(Q, 1)
        qz = column(Q, 2)
        gx = vec4()
        gy = vec4()
        gz = vec4()
        for i in range(3):
            ai = madd(madd(a, step[i] - f[0], qx), -f[2], qz)
            for j in range(3):
                n = node(lattice, o, i, j)
                q0 = madd(ai, step[j] - f[1], qy)
                q1 = madd(q0, real(1.0), qz)
                q2 = madd(q0, real(2.0), qz)
                w = wx[i] * wy[j]
                e0 = madd_each(vec4(), gather(velocity, at + n), q0)
                e1 = madd_each(vec4(), gather(velocity, at + n + 1), q1)
                e2 = madd_each(vec4(), gather(velocity, at + n + 2), q2)
                scatter(velocity_bar, n, w * wz[0], q0)
                scatter(velocity_bar, n + 1, w * wz[1], q1)
                scatter(velocity_bar, n + 2, w * wz[2], q2)
                e = madd(madd(scaled(wz[0], e0), wz[1], e1), wz[2], e2)
                gx = madd(gx, sx[i] * wy[j], e)
                gy = madd(gy, wx[i] * sy[j], e)
                gz = madd(gz, w, madd(madd(scaled(sz[0], e0), sz[1], e1), sz[2], e2))
        slope = vec3(total(gx), total(gy), total(gz))
        bar.x[p] = bar.x[p] + (slope - wp.transpose(Q) * states.v[next_slot, p]) / lattice.dx
        bar.F[p] = F_bar + lattice.dt * (wp.transpose(states.C[next_slot, p]) * F_bar)

    @wp.func
    def grid_adjoint(
        n: int,
        at: int,
        drag: wp.array(dtype=real),
        velocity: wp.array(dtype=vec4),
        velocity_bar: wp.array(dtype=vec4),
        momentum_bar: wp.array(dtype=vec4),
        drag_bar: wp.array(dtype=real),
    ):
        b = velocity_bar[n]
        if b[0] == real(0.0) and b[1] == real(0.0) and b[2] == real(0.0):
            momentum_bar[n] = vec4()
            return
        velocity_bar[n] = vec4()
        v = velocity[at + n]
        scale = v[3]
        along = (b[0] * v[0] + b[1] * v[1] + b[2] * v[2]) / drag[0]
        momentum_bar[n] = vec4(scale * b[0], scale * b[1], scale * b[2], -scale * along)
        drag_bar[n] = drag_bar[n] + along

    @wp.func
    def p2g_adjoint(
        p: int,
        lattice: Lattice,
        slot: int,
        states: States,
        material: Material,
        momentum_bar: wp.array(dtype=vec4),
        bar: StateBar,
        material_bar: Material,
    ):
        u = cell(lattice, states.x[slot, p])
        if not inside(lattice, u):
            return
        o = first(u)
        f = past(u, o)
        step = vec3(real(0.0), real(1.0), real(2.0))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        sx = slopes(f[0])
        sy = slopes(f[1])
        sz = slopes(f[2])
        mass = material.mass[p]
        mu = material.mu[p]
        lam = material.lam[p]
        impulse = lattice.dt * material.volume[p]
        F = states.F[slot, p]
        C = states.C[slot, p]
        v = states.v[slot, p]
        A = lattice.dx * (mass * C - (lattice.affine * impulse) * stress(F, mu, lam))
        b = lift(mass * v + impulse * material.body[p], mass)
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
                n = node(lattice, o, i, j)
                h = madd(bi, step[j] - f[1], ay)
                g0 = gather(momentum_bar, n)
                g1 = gather(momentum_bar, n + 1)
                g2 = gather(momentum_bar, n + 2)
                e0 = madd_each(vec4(), g0, h)
                e1 = madd_each(vec4(), g1, madd(h, real(1.0), az))
                e2 = madd_each(vec4(), g2, madd(h, real(2.0), az))
                w = wx[i] * wy[j]
                if wp.static(nodal):
                    e0 = madd_each(e0, impulse * lift(material.node_force[n], real(0.0)), g0)
                    e1 = madd_each(e1, impulse * lift(material.node_force[n + 1], real(0.0)), g1)
                    e2 = madd_each(e2, impulse * lift(material.node_force[n + 2], real(0.0)), g2)
                    for k in range(3):
                        g = gather(momentum_bar, n + k)
                        wp.atomic_add(material_bar.node_force, n + k, (impulse * w * wz[k]) * vec3(g[0], g[1], g[2]))
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
        tz = madd(tz, -f[2], received)
        slope = vec3(total(gx), total(gy), total(gz))
        b_bar = vec3(received[0], received[1], received[2])
        A_bar = lattice.dx * mat33(tx[0], ty[0], tz[0], tx[1], ty[1], tz[1], tx[2], ty[2], tz[2])
        F_bar, mu_bar, lam_bar = stress_adjoint(F, mu, lam, (-lattice.affine * impulse) * A_bar)
        bar.x[p] = bar.x[p] + (slope - wp.transpose(A) * b_bar) / lattice.dx
        bar.v[p] = mass * b_bar
        bar.C[p] = mass * A_bar
        bar.F[p] = bar.F[p] + F_bar
        material_bar.mu[p] = material_bar.mu[p] + mu_bar
        material_bar.lam[p] = material_bar.lam[p] + lam_bar
        material_bar.body[p] = material_bar.body[p] + impulse * b_bar
        material_bar.mass[p] = material_bar.mass[p] + received[3] + wp.dot(b_bar, v) + wp.ddot(A_bar, C)

    return SimpleNamespace(g2p_adjoint=g2p_adjoint, grid_adjoint=grid_adjoint, p2g_adjoint=p2g_adjoint)
