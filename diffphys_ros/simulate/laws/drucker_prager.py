"""Dry sand (Klar et al. 2016): a Hencky solid whose shear stress is bounded by friction and which bears no tension.

With the strain deviator d and trace t, |d| <= -(1 + 3 lam / (2 mu)) alpha t where t < 0, and d = 0 where t >= 0, with
alpha = sqrt(2/3) 2 sin(phi) / (3 - sin(phi)) of the friction angle phi. Flow keeps the volume. Loosened sand keeps t > 0 in
F but bears no stress until it is packed again: that is the volume correction of Tampubolon et al. (2017) without a state
variable of its own.
"""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,valid-type"

import math

import warp as wp

from . import hencky
from .law import Functions, Law, Parameter


def build(real: type) -> Functions:
    """Stress, projection and their adjoints over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)
    h = hencky.build(real)
    strain, total, hencky_stress, hencky_stress_adjoint = h.strain, h.total, h.stress, h.stress_adjoint
    returned, returned_adjoint = h.returned, h.returned_adjoint
    factor = real(2.0 * math.sqrt(2.0 / 3.0))

    @wp.func
    def cone(constants: vec4):
        """Bound on the deviator per compressive trace."""
        sine = wp.sin(constants[2])
        return (real(1.0) + real(1.5) * constants[1] / constants[0]) * factor * sine / (real(3.0) - sine)

    @wp.func
    def cone_slope(constants: vec4):
        """Derivative of cone with respect to the constants."""
        sine = wp.sin(constants[2])
        rest = real(3.0) - sine
        ratio = real(1.5) / constants[0]
        by_lam = ratio * factor * sine / rest
        by_angle = (real(1.0) + ratio * constants[1]) * real(3.0) * factor * wp.cos(constants[2]) / (rest * rest)
        return vec4(-by_lam * constants[1] / constants[0], by_lam, by_angle, real(0.0))

    @wp.func
    def stress(F: mat33, constants: vec4):
        if wp.determinant(F) >= real(1.0):
            return mat33()
        return hencky_stress(F, constants)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        if wp.determinant(F) >= real(1.0):
            return mat33(), vec4()
        return hencky_stress_adjoint(F, constants, tau_bar)

    @wp.func
    def project(F_trial: mat33, constants: vec4):
        U, _beta, h = strain(F_trial)
        return returned(F_trial, U, h, cone(constants) * wp.max(-total(h), real(0.0)))

    @wp.func
    def project_adjoint(F_trial: mat33, constants: vec4, F_bar: mat33):
        U, beta, h = strain(F_trial)
        slope = cone(constants)
        packed = wp.max(-total(h), real(0.0))
        per_trace = real(0.0)
        if packed > real(0.0):
            per_trace = -slope
        F_trial_bar, radius_bar = returned_adjoint(F_trial, U, beta, h, slope * packed, per_trace, F_bar)
        return F_trial_bar, (radius_bar * packed) * cone_slope(constants)

    return Functions(stress, stress_adjoint, project, project_adjoint)


FRICTION_ANGLE = Parameter("friction_angle_rad", math.radians(35.0), 0.0, math.radians(60.0), "angle of internal friction [rad]")
LAW = Law(build, (FRICTION_ANGLE,), elastic=False)
