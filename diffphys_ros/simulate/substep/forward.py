"""The three parts of one substep: explicit MLS-MPM with APIC transfers (Hu et al. 2018; paper Eq. 6 and 7).

    p2g     a particle -> momentum and mass of its nodes, elastic stress and forces included
    grid    a node's velocity, written from index `at` on: drag, Dirichlet nodes; empties its momentum for the next substep
    g2p     nodes -> a particle's x, v, C, F in the next substep

Nodes hold 4-vectors: momentum and mass, or velocity and (drag / mass). Anchored particles meet the grid where their anchor is (total
Lagrangian MPM: de Vaucorbeil et al. 2020): C and the stress's directions are then those of the anchor.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..laws import law_of
from .common import common
from .contact import contact
from .shared_inputs import Variant
from .transfer import stencil, transfer

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,operator,valid-type"

LEFT_GRID, INVERTED, NON_FINITE = 0, 1, 2  # what a flag says: code = (substep * particles + particle) * 4 + reason


@cache
def forward(variant: Variant) -> SimpleNamespace:
    """Warp functions p2g, grid, g2p, check."""
    real, bordered, pitch = variant.real, variant.bordered, variant.pitch
    model, t = law_of(variant.law, real), common(real)
    stress, viscous_stress, project = model.stress, model.viscous_stress, model.project
    vec3, vec4, mat33, Lattice, Particle, Material, Anchor, Affine = t.vec3, t.vec4, t.mat33, t.Lattice, t.Particle, t.Material, t.Anchor, t.Affine
    cell, inside, affine, gradient, lift, lower = t.cell, t.inside, t.affine, t.gradient, t.lift, t.lower
    get, put = t.get, t.put
    around, Load = stencil(real).around, stencil(real).Load
    Borders, meet = contact(real, bordered).Borders, contact(real, bordered).meet
    scatter, gather = transfer(real, scatters=True, loaded=variant.nodal), transfer(real, gathers=True, pitch=pitch)

    @wp.func
    def met_at(particle: Particle, anchor: Anchor):
        """Where a particle meets the grid."""
        x = particle.x
        if wp.static(variant.anchored):
            x = anchor.x
        return x

    @wp.func
    def pulled(tau: mat33, F: mat33, anchor: Anchor):
        """Kirchhoff stress as a force in the anchor's directions: tau (F F_anchor^-1)^-T."""
        return tau * (wp.transpose(wp.inverse(F)) * wp.transpose(anchor.F))

    @wp.func
    def momentum_field(lattice: Lattice, particle: Particle, material: Material, anchor: Anchor):
        """What a particle gives its nodes, per weight: momentum and mass over the distance in cells."""
        impulse = lattice.dt * material.volume
        tau = stress(particle.F, material.constants)
        if wp.static(viscous_stress is not None):
            tau = tau + viscous_stress(particle.F, particle.C, material.constants)
        if wp.static(variant.anchored):
            tau = pulled(tau, particle.F, anchor)
        A = material.mass * particle.C - (lattice.affine * impulse) * tau
        return affine(material.mass * particle.v + impulse * material.body, material.mass, lattice.dx * A)

    @wp.func
    def p2g(
        lattice: Lattice,
        particle: Particle,
        material: Material,
        anchor: Anchor,
        node_force: wp.array(dtype=vec3),
        momentum: wp.array(dtype=vec4),
    ):
        load = Load()
        load.factor = lattice.dt * material.volume
        load.force = node_force
        stencil = around(lattice, cell(lattice, met_at(particle, anchor)))
        scatter(stencil, momentum_field(lattice, particle, material, anchor), momentum, 0, momentum, load)

    @wp.func
    def grid(
        n: int,
        lattice: Lattice,
        at: int,
        substep: int,
        drag: real,
        borders: Borders,
        momentum: wp.array(dtype=vec4),
        velocity: wp.array(dtype=vec4),
    ):
        """Node n of the box. What it meets at borders leaves its velocity before in the place behind."""
        m = lattice.base + n
        q = get(momentum, m)
        if q[3] == real(0.0):
            return
        put(momentum, m, vec4())
        place = at + pitch * m
        if n < (lattice.clamp_index + 1) * lattice.ny * lattice.nz or q[3] <= lattice.empty_mass:
            put(velocity, place, vec4())
        else:
            scale = drag / q[3]
            v = scale * lower(q)
            if wp.static(bordered):
                put(velocity, place + 1, lift(v, scale))
                for plane in range(wp.static(variant.planes)):
                    near = m * wp.static(variant.planes) + plane
                    put(velocity, place + 2 + plane, get(borders.near, near))
                    put(borders.near, near, vec4())
            put(velocity, place, lift(meet(lattice, borders, substep, n, v, velocity, place + 2), scale))

    @wp.func
    def g2p(lattice: Lattice, particle: Particle, material: Material, anchor: Anchor, at: int, velocity: wp.array(dtype=vec4)):
        stencil = around(lattice, cell(lattice, met_at(particle, anchor)))
        moments, _ = gather(stencil, Affine(), velocity, at, velocity, Load())
        v = lower(moments.b)
        C = (lattice.affine * lattice.dx) * gradient(moments)
        carried = particle.F
        if wp.static(variant.anchored):
            carried = anchor.F
        F = particle.F + lattice.dt * (C * carried)
        if wp.static(project is not None):
            F = project(F, material.constants)
        return Particle(particle.x + lattice.dt * v, v, C, F)

    @wp.func
    def check(p: int, particles: int, lattice: Lattice, after: Particle, anchor: Anchor, substep: int, flags: wp.array(dtype=wp.int64)):
        """Note the first particle of a simulation whose next state no longer makes sense."""
        ratio = wp.determinant(after.F)
        if not (inside(lattice, cell(lattice, met_at(after, anchor))) and ratio > real(0.0) and wp.isfinite(ratio)):
            reason = wp.int64(LEFT_GRID)
            if ratio <= real(0.0):
                reason = wp.int64(INVERTED)
            if not wp.isfinite(wp.length_sq(after.x) + ratio):
                reason = wp.int64(NON_FINITE)
            code = (wp.int64(substep) * wp.int64(particles) + wp.int64(p % particles)) * wp.int64(4) + reason
            wp.atomic_min(flags, p // particles, code)

    return SimpleNamespace(p2g=p2g, grid=grid, g2p=g2p, check=check, momentum_field=momentum_field, met_at=met_at)
