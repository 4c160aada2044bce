"""The adjoint of one substep, by hand: the derivative of forward.py read backwards.

    g2p_adjoint    adjoint of a particle's next state -> adjoint of nodal velocities, parts of the adjoints of x and F or of the anchor
    grid_adjoint   adjoint of a node's velocity -> adjoints of its momentum and mass, and of the drag factor
    p2g_adjoint    adjoints of momentum and mass -> adjoints of a particle's state, constants, body force and mass

The states before and after the substep and the nodal velocities between them must be at hand. Names end in _bar for
dL/d(name).
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from ..laws import law_of
from .common import common
from .contact import contact
from .forward import forward
from .shared_inputs import Variant
from .transfer import stencil, transfer

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,operator,valid-type"


@cache
def adjoint(variant: Variant) -> SimpleNamespace:
    """Warp functions g2p_adjoint, grid_adjoint, p2g_adjoint."""
    real, bordered, pitch = variant.real, variant.bordered, variant.pitch
    model, t, part = law_of(variant.law, real), common(real), forward(variant)
    momentum_field, met_at, stress = part.momentum_field, part.met_at, model.stress
    stress_adjoint, viscous_stress_adjoint, project_adjoint = model.stress_adjoint, model.viscous_stress_adjoint, model.project_adjoint
    vec3, vec4, mat33, Lattice, Particle, Material, Anchor = t.vec3, t.vec4, t.mat33, t.Lattice, t.Particle, t.Material, t.Anchor
    cell, affine, gradient, lift, lower = t.cell, t.affine, t.gradient, t.lift, t.lower
    get, put = t.get, t.put
    around, Load = stencil(real).around, stencil(real).Load
    Borders, meet_adjoint = contact(real, bordered).Borders, contact(real, bordered).meet_adjoint
    scatter_slope = transfer(real, scatters=True, slopes=True, pitch=pitch)
    gather_slope = transfer(real, gathers=True, slopes=True, loaded=variant.nodal)

    @wp.func
    def g2p_adjoint(
        lattice: Lattice,
        particle: Particle,
        following: Particle,
        material: Material,
        anchor: Anchor,
        at: int,
        velocity: wp.array(dtype=vec4),
        bar: Particle,
        material_bar: Material,
        anchor_bar: Anchor,
        velocity_bar: wp.array(dtype=vec4),
    ):
        """`bar` holds the adjoint of the `following` state; returns what of it the nodes do not pass on."""
        F_bar = bar.F
        if wp.static(project_adjoint is not None):
            F_trial = particle.F + lattice.dt * (following.C * particle.F)
            F_bar, constants_bar = project_adjoint(F_trial, material.constants, bar.F)
            material_bar.constants = material_bar.constants + constants_bar
        carried = particle.F
        if wp.static(variant.anchored):
            carried = anchor.F
        Q = (lattice.affine * lattice.dx) * (bar.C + lattice.dt * (F_bar * wp.transpose(carried)))
        field = affine(bar.v + lattice.dt * bar.x, real(0.0), Q)
        stencil = around(lattice, cell(lattice, met_at(particle, anchor)))
        _, slope = scatter_slope(stencil, field, velocity, at, velocity_bar, Load())
        moved = (slope - wp.transpose(Q) * following.v) / lattice.dx
        stretched = lattice.dt * (wp.transpose(following.C) * F_bar)
        x_bar = bar.x
        if wp.static(variant.anchored):
            anchor_bar.x = anchor_bar.x + moved
            anchor_bar.F = anchor_bar.F + stretched
        else:
            x_bar = x_bar + moved
            F_bar = F_bar + stretched
        return Particle(x_bar, vec3(), mat33(), F_bar), material_bar, anchor_bar

    @wp.func
    def grid_adjoint(
        n: int,
        lattice: Lattice,
        at: int,
        substep: int,
        drag: real,
        borders: Borders,
        velocity: wp.array(dtype=vec4),
        velocity_bar: wp.array(dtype=vec4),
        momentum_bar: wp.array(dtype=vec4),
        drag_bar: wp.array(dtype=real),
        borders_bar: Borders,
    ):
        """Node n of the box."""
        m = lattice.base + n
        for plane in range(wp.static(variant.planes)):
            put(borders_bar.near, m * wp.static(variant.planes) + plane, vec4())
        b = get(velocity_bar, m)
        if b[0] == real(0.0) and b[1] == real(0.0) and b[2] == real(0.0):
            put(momentum_bar, m, vec4())
            return
        put(velocity_bar, m, vec4())
        place = at + pitch * m
        v = get(velocity, place)
        scale = v[3]
        if wp.static(bordered):  # noqa: SIM102 (static: compiled or not)
            if scale != real(0.0):
                v = get(velocity, place + 1)
                b = lift(meet_adjoint(lattice, borders, substep, n, lower(v), lower(b), velocity, place + 2, borders_bar), real(0.0))
        along = (b[0] * v[0] + b[1] * v[1] + b[2] * v[2]) / drag
        put(momentum_bar, m, vec4(scale * b[0], scale * b[1], scale * b[2], -scale * along))
        drag_bar[m] = drag_bar[m] + along

    @wp.func
    def pulled_adjoint(tau: mat33, F: mat33, anchor: Anchor, bar: mat33):
        """(tau_bar, F_bar, adjoint of the anchor's F) of forward.py's `pulled`."""
        K = wp.transpose(wp.inverse(F))
        H_bar = wp.transpose(tau) * bar
        tau_bar = bar * (anchor.F * wp.transpose(K))
        return tau_bar, -(K * wp.transpose(H_bar * anchor.F)) * K, wp.transpose(H_bar) * K

    @wp.func
    def p2g_adjoint(
        lattice: Lattice,
        particle: Particle,
        material: Material,
        anchor: Anchor,
        node_force: wp.array(dtype=vec3),
        momentum_bar: wp.array(dtype=vec4),
        bar: Particle,
        material_bar: Material,
        anchor_bar: Anchor,
        node_force_bar: wp.array(dtype=vec3),
    ):
        """`bar` holds what g2p_adjoint returned; returns the adjoint of the state, and `material_bar` with this substep's share."""
        impulse, mass = lattice.dt * material.volume, material.mass
        field = momentum_field(lattice, particle, material, anchor)
        load = Load(impulse, node_force, node_force_bar)
        stencil = around(lattice, cell(lattice, met_at(particle, anchor)))
        moments, slope = gather_slope(stencil, field, momentum_bar, 0, momentum_bar, load)
        b_bar = lower(moments.b)
        A_bar = lattice.dx * gradient(moments)
        tau_bar = (-lattice.affine * impulse) * A_bar
        C_bar = mass * A_bar
        through_pull = mat33()
        if wp.static(variant.anchored):
            tau = stress(particle.F, material.constants)
            tau_bar, through_pull, pull_bar = pulled_adjoint(tau, particle.F, anchor, tau_bar)
            anchor_bar.F = anchor_bar.F + pull_bar
        F_bar, constants_bar = stress_adjoint(particle.F, material.constants, tau_bar)
        F_bar = F_bar + through_pull
        if wp.static(viscous_stress_adjoint is not None):
            through_F, through_C, through_constants = viscous_stress_adjoint(particle.F, particle.C, material.constants, tau_bar)
            F_bar = F_bar + through_F
            C_bar = C_bar + through_C
            constants_bar = constants_bar + through_constants
        moved = (slope - wp.transpose(gradient(field)) * b_bar) / lattice.dx
        x_bar = bar.x
        if wp.static(variant.anchored):
            anchor_bar.x = anchor_bar.x + moved
        else:
            x_bar = x_bar + moved
        material_bar.constants = material_bar.constants + constants_bar
        material_bar.body = material_bar.body + impulse * b_bar
        material_bar.mass = material_bar.mass + moments.b[3] + wp.dot(b_bar, particle.v) + wp.ddot(A_bar, particle.C)
        return Particle(x_bar, mass * b_bar, C_bar, bar.F + F_bar), material_bar, anchor_bar

    return SimpleNamespace(g2p_adjoint=g2p_adjoint, grid_adjoint=grid_adjoint, p2g_adjoint=p2g_adjoint)
