"""Compressible neo-Hookean solid: tau = mu (F F^T - I) + lam log(J) I (Bonet and Wood, eq. 6.28)."""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

import warp as wp

from .law import Functions, Law


def build(real: type) -> Functions:
    """Stress and its adjoint over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)

    @wp.func
    def stress(F: mat33, constants: vec4):
        unit = wp.identity(3, dtype=real)
        return constants[0] * (F * wp.transpose(F) - unit) + constants[1] * wp.log(wp.determinant(F)) * unit

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        mu = constants[0]
        lam = constants[1]
        log_j = wp.log(wp.determinant(F))
        pressure_bar = wp.trace(tau_bar)
        F_bar = mu * ((tau_bar + wp.transpose(tau_bar)) * F) + (lam * pressure_bar) * wp.transpose(wp.inverse(F))
        mu_bar = wp.ddot(tau_bar, F * wp.transpose(F)) - pressure_bar
        return F_bar, vec4(mu_bar, log_j * pressure_bar, real(0.0), real(0.0))

    return Functions(stress, stress_adjoint)


LAW = Law(build)
