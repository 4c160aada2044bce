"""How far material still is from the planes it may leave: Warp functions over one particle, and their adjoint.

A node feels a particle up to 1.5 cells away. So that a separating plane stops a body where it is, and not a cell earlier,
every particle near the plane tells its nodes its distance: with w the spline's weight, g the distance of the particle's
surface and c = (1 - g / size)^2 up to one particle size above, a node receives sum w c and sum w c g, and the quotient is the
distance of the material around it. contact.py lets the node approach no faster than would cover that distance in a
few substeps. So a body lands on the plane wherever that lies in the grid, and where it comes to rest does not depend on
where in a substep it met the plane, nor on how high it fell from: the gradient through a landing is that of the motion.

Nodes of anchored particles stand where the motion started. Their height above the plane is told, too: the sum of w c h, with h the
height to which the particle has carried the node, x + F F_anchor^-1 (x_i - x_anchor). It only says which nodes the plane acts on.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from .common import common
from .contact import contact
from .transfer import stencil

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="attr-defined,operator,valid-type"


@cache
def approach(real: type, anchored: bool) -> SimpleNamespace:
    """Warp functions `tell(lattice, particle, anchor, volume, borders)`, and `tell_adjoint`, which returns (x_bar, anchor's x_bar)."""
    t, s, c = common(real), stencil(real), contact(real, True)
    vec3, vec4, Lattice, Particle, Anchor, Borders = t.vec3, t.vec4, t.Lattice, t.Particle, t.Anchor, c.Borders
    cell, around, weight, slope, separate = t.cell, s.around, s.weight, s.slope, c.separate

    @wp.func
    def distance(borders: Borders, plane: int, x: vec3, size: real):
        """Of a particle's surface from a plane [m]; one size where the plane does not ask."""
        if borders.kind[plane] != separate:
            return size
        return wp.min(wp.dot(borders.normal[plane], x) - borders.offset[plane] - real(0.5) * size, size)

    @wp.func
    def met_at(particle: Particle, anchor: Anchor):
        """Where a particle meets the grid."""
        x = particle.x
        if wp.static(anchored):
            x = anchor.x
        return x

    @wp.func
    def upward(lattice: Lattice, normal: vec3, particle: Particle, anchor: Anchor):
        """What a node's height gains per cell of its distance from an anchored particle [m]."""
        up = vec3()
        if wp.static(anchored):
            up = lattice.dx * (wp.transpose(particle.F * wp.inverse(anchor.F)) * normal)
        return up

    @wp.func
    def tell(lattice: Lattice, particle: Particle, anchor: Anchor, volume: real, borders: Borders):
        size = wp.cbrt(volume)
        planes = borders.normal.shape[0]
        for plane in range(planes):
            g = distance(borders, plane, particle.x, size)
            if g < size:
                close = (real(1.0) - g / size) * (real(1.0) - g / size)
                st = around(lattice, cell(lattice, met_at(particle, anchor)))
                up = upward(lattice, borders.normal[plane], particle, anchor)
                first = g + real(0.5) * size - wp.dot(up, st.f)  # height of node (0, 0, 0)
                for a in range(27):
                    i, j, k = a // 9, (a // 3) % 3, a % 3
                    w = weight(st.f[0], i) * weight(st.f[1], j) * weight(st.f[2], k) * close
                    height = first + real(i) * up[0] + real(j) * up[1] + real(k) * up[2]
                    m = st.first + (i * st.ny + j) * st.nz + k
                    wp.atomic_add(borders.near, m * planes + plane, vec4(w, w * g, w * height, real(0.0)))

    @wp.func
    def tell_adjoint(lattice: Lattice, particle: Particle, anchor: Anchor, volume: real, borders: Borders, borders_bar: Borders):
        size = wp.cbrt(volume)
        planes = borders.normal.shape[0]
        x_bar, met_bar = vec3(), vec3()
        for plane in range(planes):
            g = distance(borders, plane, particle.x, size)
            if g < size:
                close = (real(1.0) - g / size) * (real(1.0) - g / size)
                fall = real(-2.0) * (real(1.0) - g / size) / size
                st = around(lattice, cell(lattice, met_at(particle, anchor)))
                steep, along = vec3(), real(0.0)
                for a in range(27):
                    i, j, k = a // 9, (a // 3) % 3, a % 3
                    wx, wy, wz = weight(st.f[0], i), weight(st.f[1], j), weight(st.f[2], k)
                    bar = borders_bar.near[(st.first + (i * st.ny + j) * st.nz + k) * planes + plane]
                    both = bar[0] + g * bar[1]
                    along = along + wx * wy * wz * (fall * both + close * bar[1])
                    sx, sy, sz = slope(st.f[0], i), slope(st.f[1], j), slope(st.f[2], k)
                    steep = steep + (close * both) * vec3(sx * wy * wz, wx * sy * wz, wx * wy * sz)
                x_bar = x_bar + along * borders.normal[plane]
                met_bar = met_bar + steep / lattice.dx
        if wp.static(not anchored):
            x_bar = x_bar + met_bar
        return x_bar, met_bar

    return SimpleNamespace(tell=tell, tell_adjoint=tell_adjoint)
