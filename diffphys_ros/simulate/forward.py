"""The three parts of one substep: explicit MLS-MPM with APIC transfers (Hu et al. 2018; paper Eq. 6 and 7).

    p2g     a particle -> momentum and mass of its nodes, elastic stress and forces included
    grid    a node's velocity, written from node `at` on: drag, Dirichlet nodes; empties its momentum for the next substep
    g2p     nodes -> a particle's x, v, C, F in the next substep, and the flag of what went wrong

Nodes hold 4-vectors: momentum and mass, or velocity and (drag / mass). The stencil is unrolled along k by hand.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .common import common
from .laws import LAWS

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

LEFT_GRID, INVERTED, NON_FINITE = 0, 1, 2  # what a flag says: code = (substep * particles + particle) * 4 + reason


@cache
def forward(law: str, real: type, nodal: bool) -> SimpleNamespace:
    """Warp functions p2g, grid, g2p for a law's name and a scalar type; `nodal`: a force density on the nodes acts too."""
    stress, _ = LAWS[law](real)
    t = common(real)
    vec3, vec4, mat33, Lattice, States, Material = t.vec3, t.vec4, t.mat33, t.Lattice, t.States, t.Material
    cell, inside, first, past, node, lift, column, weights = t.cell, t.inside, t.first, t.past, t.node, t.lift, t.column, t.weights
    scaled, madd, gather, scatter = t.scaled, t.madd, t.gather, t.scatter

    @wp.func
    def p2g(p: int, lattice: Lattice, slot: int, states: States, material: Material, momentum: wp.array(dtype=vec4)):
        u = cell(lattice, states.x[slot, p])
        if not inside(lattice, u):
            return
        o = first(u)
        f = past(u, o)
        step = vec3(real(0.0), real(1.0), real(2.0))
        wx = weights(f[0])
        wy = weights(f[1])
        wz = weights(f[2])
        mass = material.mass[p]
        impulse = lattice.dt * material.volume[p]
        A = mass * states.C[slot, p] - (lattice.affine * impulse) * stress(states.F[slot, p], material.mu[p], material.lam[p])
        A = lattice.dx * A
        b = lift(mass * states.v[slot, p] + impulse * material.body[p], mass)
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        for i in range(3):
            bi = madd(madd(b, step[i] - f[0], ax), -f[2], az)
            for j in range(3):
                n = node(lattice, o, i, j)
                w = wx[i] * wy[j]
                h = madd(bi, step[j] - f[1], ay)
                scatter(momentum, n, w * wz[0], h)
                scatter(momentum, n + 1, w * wz[1], madd(h, real(1.0), az))
                scatter(momentum, n + 2, w * wz[2], madd(h, real(2.0), az))
                if wp.static(nodal):
                    for k in range(3):
                        scatter(momentum, n + k, w * impulse * wz[k], lift(material.node_force[n + k], real(0.0)))

    @wp.func
    def grid(n: int, lattice: Lattice, at: int, drag: wp.array(dtype=real), momentum: wp.array(dtype=vec4), velocity: wp.array(dtype=vec4)):
        q = momentum[n]
        if q[3] == real(0.0):
            return
        momentum[n] = vec4()
        if n < (lattice.clamp_index + 1) * lattice.ny * lattice.nz or q[3] <= lattice.empty_mass:
            velocity[at + n] = vec4()
        else:
            scale = drag[0] / q[3]
            velocity[at + n] = vec4(scale * q[0], scale * q[1], scale * q[2], scale)

    @wp.func
    def g2p(
        p: int,
        lattice: Lattice,
        slot: int,
        next_slot: int,
        substep: int,
        at: int,
        velocity: wp.array(dtype=vec4),
        states: States,
        flag: wp.array(dtype=wp.int64),
    ):
        x = states.x[slot, p]
        u = cell(lattice, x)
        if not inside(lattice, u):
            return
        o = first(u)
        f = past(u, o)
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
                n = at + node(lattice, o, i, j)
                g1 = scaled(wz[1], gather(velocity, n + 1))
                g2 = scaled(wz[2], gather(velocity, n + 2))
                w = wx[i] * wy[j]
                s = scaled(w, madd(madd(g1, wz[0], gather(velocity, n)), real(1.0), g2))
                v = madd(v, real(1.0), s)
                bx = madd(bx, step[i] - f[0], s)
                by = madd(by, step[j] - f[1], s)
                bz = madd(bz, w, madd(g1, real(2.0), g2))
        bz = madd(bz, -f[2], v)
        C = (lattice.affine * lattice.dx) * mat33(bx[0], by[0], bz[0], bx[1], by[1], bz[1], bx[2], by[2], bz[2])
        v3 = vec3(v[0], v[1], v[2])
        F = states.F[slot, p]
        F = F + lattice.dt * (C * F)
        x = x + lattice.dt * v3
        states.x[next_slot, p] = x
        states.v[next_slot, p] = v3
        states.C[next_slot, p] = C
        states.F[next_slot, p] = F
        ratio = wp.determinant(F)
        if not (inside(lattice, cell(lattice, x)) and ratio > real(0.0) and wp.isfinite(ratio)):
            reason = wp.int64(LEFT_GRID)
            if ratio <= real(0.0):
                reason = wp.int64(INVERTED)
            if not wp.isfinite(wp.length_sq(x) + ratio):
                reason = wp.int64(NON_FINITE)
            particles = wp.int64(states.x.shape[1])
            wp.atomic_min(flag, 0, (wp.int64(substep) * particles + wp.int64(p)) * wp.int64(4) + reason)

    return SimpleNamespace(p2g=p2g, grid=grid, g2p=g2p)
