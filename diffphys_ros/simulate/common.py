"""Types and small functions that the forward and the adjoint substep share, as Warp code over a scalar type."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import lanes

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors


@cache
def common(real: type) -> SimpleNamespace:
    """Everything below, over `real` (wp.float32 or wp.float64)."""
    vec3, vec4, mat33 = wp.types.vector(3, real), wp.types.vector(4, real), wp.types.matrix((3, 3), real)

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

    @wp.struct
    class States:  # of consecutive substeps, each (slots, P); or the adjoint of one, in slot 0
        x: wp.array2d(dtype=vec3)
        v: wp.array2d(dtype=vec3)
        C: wp.array2d(dtype=mat33)
        F: wp.array2d(dtype=mat33)

    @wp.struct
    class Materials:  # of all particles, and the force density per node (or one unused entry)
        constants: wp.array(dtype=vec4)  # of the law
        body: wp.array(dtype=vec3)
        volume: wp.array(dtype=real)
        mass: wp.array(dtype=real)
        node_force: wp.array(dtype=vec3)

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
    class Affine:  # the field b + x d_x + y d_y + z d_z of the distance d from a point in cells, or the moments of one
        b: vec4
        x: vec4
        y: vec4
        z: vec4

    @wp.func
    def cell(lattice: Lattice, x: vec3):
        return (x - lattice.origin) / lattice.dx

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
        return Affine(
            lift(b, w),
            lift(A * vec3(real(1.0), zero, zero), zero),
            lift(A * vec3(zero, real(1.0), zero), zero),
            lift(A * vec3(zero, zero, real(1.0)), zero),
        )

    @wp.func
    def gradient(m: Affine):
        return mat33(m.x[0], m.y[0], m.z[0], m.x[1], m.y[1], m.z[1], m.x[2], m.y[2], m.z[2])

    @wp.func
    def load(states: States, slot: int, p: int):
        return Particle(states.x[slot, p], states.v[slot, p], states.C[slot, p], states.F[slot, p])

    @wp.func
    def store(states: States, slot: int, p: int, particle: Particle):
        states.x[slot, p] = particle.x
        states.v[slot, p] = particle.v
        states.C[slot, p] = particle.C
        states.F[slot, p] = particle.F

    @wp.func
    def material_of(materials: Materials, p: int):
        return Material(materials.constants[p], materials.body[p], materials.volume[p], materials.mass[p])

    @wp.func
    def put_material(materials: Materials, p: int, material: Material):
        materials.constants[p] = material.constants
        materials.body[p] = material.body
        materials.mass[p] = material.mass

    return SimpleNamespace(**locals(), **vars(lanes.build(real)))
