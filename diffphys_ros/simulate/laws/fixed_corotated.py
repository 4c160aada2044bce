"""Fixed corotated solid (Stomakhin et al. 2012): P = 2 mu (F - R) + lam (J - 1) J F^-T with the rotation R of F."""

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
        j = wp.determinant(F)
        shear = real(2.0) * constants[0] * (F - rotation(F))
        return shear * wp.transpose(F) + constants[1] * (j - real(1.0)) * j * wp.identity(3, dtype=real)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        R = rotation(F)
        j = wp.determinant(F)
        mu = real(2.0) * constants[0]
        trace_bar = wp.trace(tau_bar)
        shear_bar = tau_bar * F
        j_bar = constants[1] * (real(2.0) * j - real(1.0)) * trace_bar
        F_bar = mu * (shear_bar + wp.transpose(tau_bar) * (F - R) - rotation_adjoint(F, R, shear_bar))
        mu_bar = real(2.0) * wp.ddot(shear_bar, F - R)
        constants_bar = vec4(mu_bar, (j - real(1.0)) * j * trace_bar, real(0.0), real(0.0))
        return F_bar + (j_bar * j) * wp.transpose(wp.inverse(F)), constants_bar

    return Functions(stress, stress_adjoint)


LAW = Law(build)
