"""Types and small functions that the forward and the adjoint substep share, as Warp code over a scalar type."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import warp as wp

from . import vec4_native as lanes

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"


@cache
def common(real: type) -> SimpleNamespace:
    """Everything below, over `real` (wp.float32 or wp.float64)."""
    vec3, vec4, mat33 = wp.types.vector(3, real), wp.types.vector(4, real), wp.types.matrix((3, 3), real)
    # of consecutive substeps, (slots, 6 B P): State's 24 scalars each; or an adjoint in slot 0
    States: Any = wp.array2d(dtype=vec4)
    vectors = lanes.build(real)
    get, put, recall, keep = vectors.get, vectors.put, vectors.recall, vectors.keep

    @wp.struct
    class Lattice:  # the box of the grid that one simulation runs on
        simulation: int
        origin: vec3  # node (0, 0, 0) of the whole grid [m]
        low: vec3  # the box's first node in it; positions are rounded alike whatever the box
        dx: real  # [m]
        dt: real  # [s]
        affine: real  # 4 / dx^2 [1/m^2]: inverse of the quadratic spline's second moment
        empty_mass: real  # nodes lighter than this are empty [kg]
        nx: int
        ny: int
        nz: int
        base: int  # index of the box's first node in the nodal arrays
        clamp_index: int  # nodes with i <= clamp_index are held

    @wp.struct
    class Materials:  # of all particles, and the force density per node (or one unused entry)
        constants: wp.array(dtype=vec4)  # of the law
        body: wp.array(dtype=vec3)
        volume: wp.array(dtype=real)
        mass: wp.array(dtype=real)
        node_force: wp.array(dtype=vec3)
        anchor: wp.array(dtype=vec4)  # x and F of a particle in its anchor, three each; empty where weights move along

    @wp.struct
    class Particle:  # the state of one, or its adjoint
        x: vec3
        v: vec3
        C: mat33
        F: mat33

    @wp.struct
    class Material:  # of one particle, or its adjoint
        constants: vec4
        body: vec3
        volume: real
        mass: real

    @wp.struct
    class Anchor:  # where a particle had the weights that it keeps, or the adjoint of that
        x: vec3
        F: mat33

    @wp.struct
    class Affine:  # the field b + x d_x + y d_y + z d_z of the distance d from a point in cells, or the moments of one
        b: vec4
        x: vec4
        y: vec4
        z: vec4

    @wp.func
    def cell(lattice: Lattice, x: vec3):
        return (x - lattice.origin) / lattice.dx - lattice.low

    @wp.func
    def inside(lattice: Lattice, u: vec3):
        low = wp.min(u[0], wp.min(u[1], u[2])) >= real(0.5)
        high = u[0] < real(lattice.nx) - real(1.5) and u[1] < real(lattice.ny) - real(1.5) and u[2] < real(lattice.nz) - real(1.5)
        return low and high

    @wp.func
    def lift(a: vec3, w: real):
        return vec4(a[0], a[1], a[2], w)

    @wp.func
    def lower(a: vec4):
        return vec3(a[0], a[1], a[2])

    @wp.func
    def affine(b: vec3, w: real, A: mat33):
        zero = real(0.0)
        x, y, z = vec4(A[0, 0], A[1, 0], A[2, 0], zero), vec4(A[0, 1], A[1, 1], A[2, 1], zero), vec4(A[0, 2], A[1, 2], A[2, 2], zero)
        return Affine(lift(b, w), x, y, z)  # type: ignore[call-arg]

    @wp.func
    def gradient(m: Affine):
        return mat33(m.x[0], m.y[0], m.z[0], m.x[1], m.y[1], m.z[1], m.x[2], m.y[2], m.z[2])

    @wp.func
    def load(states: States, slot: int, p: int):
        a, b, c = recall(states, slot, 6 * p), recall(states, slot, 6 * p + 1), recall(states, slot, 6 * p + 2)
        d, e, f = recall(states, slot, 6 * p + 3), recall(states, slot, 6 * p + 4), recall(states, slot, 6 * p + 5)
        C = mat33(b[2], b[3], c[0], c[1], c[2], c[3], d[0], d[1], d[2])
        return Particle(vec3(a[0], a[1], a[2]), vec3(a[3], b[0], b[1]), C, mat33(d[3], e[0], e[1], e[2], e[3], f[0], f[1], f[2], f[3]))  # type: ignore[call-arg]

    @wp.func
    def store(states: States, slot: int, p: int, s: Particle):
        C, F = s.C, s.F
        keep(states, slot, 6 * p, vec4(s.x[0], s.x[1], s.x[2], s.v[0]))
        keep(states, slot, 6 * p + 1, vec4(s.v[1], s.v[2], C[0, 0], C[0, 1]))
        keep(states, slot, 6 * p + 2, vec4(C[0, 2], C[1, 0], C[1, 1], C[1, 2]))
        keep(states, slot, 6 * p + 3, vec4(C[2, 0], C[2, 1], C[2, 2], F[0, 0]))
        keep(states, slot, 6 * p + 4, vec4(F[0, 1], F[0, 2], F[1, 0], F[1, 1]))
        keep(states, slot, 6 * p + 5, vec4(F[1, 2], F[2, 0], F[2, 1], F[2, 2]))

    @wp.func
    def material_of(materials: Materials, p: int):
        return Material(get(materials.constants, p), materials.body[p], materials.volume[p], materials.mass[p])  # type: ignore[call-arg]

    @wp.func
    def put_material(materials: Materials, p: int, material: Material):
        put(materials.constants, p, material.constants)
        materials.body[p] = material.body
        materials.mass[p] = material.mass

    @wp.func
    def anchor_of(materials: Materials, p: int):
        a, b, c = get(materials.anchor, 3 * p), get(materials.anchor, 3 * p + 1), get(materials.anchor, 3 * p + 2)
        return Anchor(vec3(a[0], a[1], a[2]), mat33(a[3], b[0], b[1], b[2], b[3], c[0], c[1], c[2], c[3]))  # type: ignore[call-arg]

    @wp.func
    def put_anchor(materials: Materials, p: int, anchor: Anchor):
        x, F = anchor.x, anchor.F
        put(materials.anchor, 3 * p, vec4(x[0], x[1], x[2], F[0, 0]))
        put(materials.anchor, 3 * p + 1, vec4(F[0, 1], F[0, 2], F[1, 0], F[1, 1]))
        put(materials.anchor, 3 * p + 2, vec4(F[1, 2], F[2, 0], F[2, 1], F[2, 2]))

    return SimpleNamespace(**(locals() | vars(vectors)))
