"""Types and small functions that the forward and the adjoint substep share, as Warp code over a scalar type."""

from functools import cache
from types import SimpleNamespace

import warp as wp

from . import lanes, spline

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors


@cache
def common(real: type) -> SimpleNamespace:
    """Everything below, over `real` (wp.float32 or wp.float64)."""
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

    @wp.struct
    class States:  # of consecutive substeps, each (slots, P)
        x: wp.array2d(dtype=vec3)
        v: wp.array2d(dtype=vec3)
        C: wp.array2d(dtype=mat33)
        F: wp.array2d(dtype=mat33)

    @wp.struct
    class Material:  # per particle, and the force density per node (or one unused entry)
        mu: wp.array(dtype=real)
        lam: wp.array(dtype=real)
        body: wp.array(dtype=vec3)
        volume: wp.array(dtype=real)
        mass: wp.array(dtype=real)
        node_force: wp.array(dtype=vec3)

    @wp.struct
    class StateBar:  # adjoint of the present state, each (P,)
        x: wp.array(dtype=vec3)
        v: wp.array(dtype=vec3)
        C: wp.array(dtype=mat33)
        F: wp.array(dtype=mat33)

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
    def past(u: vec3, o: wp.vec3i):
        return u - vec3(real(o[0]), real(o[1]), real(o[2]))

    @wp.func
    def node(lattice: Lattice, o: wp.vec3i, i: int, j: int):
        return ((o[0] + i) * lattice.ny + o[1] + j) * lattice.nz + o[2]

    @wp.func
    def lift(a: vec3, w: real):
        return vec4(a[0], a[1], a[2], w)

    @wp.func
    def column(A: mat33, j: int):
        return vec4(A[0, j], A[1, j], A[2, j], real(0.0))

    return SimpleNamespace(**locals(), **vars(lanes.build(real)))
