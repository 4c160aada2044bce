"""Linear corotated solid: P = R (2 mu e + lam tr(e) I), e = R^T F - I with the rotation R of F (Sifakis and Barbic 2012)."""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

import warp as wp

from . import polar
from .law import Functions, Law


def build(real: type) -> Functions:
    """Stress and its adjoint over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)
    rotation, rotation_adjoint = polar.build(real).rotation, polar.build(real).rotation_adjoint

    @wp.func
    def stress(F: mat33, constants: vec4):
        R = rotation(F)
        first_piola = real(2.0) * constants[0] * (F - R) + constants[1] * (wp.ddot(R, F) - real(3.0)) * R
        return first_piola * wp.transpose(F)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        R = rotation(F)
        mu = real(2.0) * constants[0]
        lam = constants[1]
        dilation = wp.ddot(R, F) - real(3.0)
        first_piola = mu * (F - R) + lam * dilation * R
        P_bar = tau_bar * F
        along = wp.ddot(P_bar, R)
        R_bar = (lam * dilation - mu) * P_bar + (lam * along) * F
        F_bar = wp.transpose(tau_bar) * first_piola + mu * P_bar + (lam * along) * R + rotation_adjoint(F, R, R_bar)
        return F_bar, vec4(real(2.0) * wp.ddot(P_bar, F - R), dilation * along, real(0.0), real(0.0))

    return Functions(stress, stress_adjoint)


LAW = Law(build)
