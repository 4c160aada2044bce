"""St. Venant-Kirchhoff solid: P = F S, S = 2 mu E + lam tr(E) I, E = (F^T F - I) / 2; tau = F S F^T."""

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="index,operator,valid-type"

import warp as wp

from .law import Functions, Law


def build(real: type) -> Functions:
    """Stress and its adjoint over `real`."""
    mat33, vec4 = wp.types.matrix((3, 3), real), wp.types.vector(4, real)

    @wp.func
    def strain(F: mat33):
        return real(0.5) * (wp.transpose(F) * F - wp.identity(3, dtype=real))

    @wp.func
    def hooke(strain: mat33, constants: vec4):
        return real(2.0) * constants[0] * strain + constants[1] * wp.trace(strain) * wp.identity(3, dtype=real)

    @wp.func
    def stress(F: mat33, constants: vec4):
        return F * hooke(strain(F), constants) * wp.transpose(F)

    @wp.func
    def stress_adjoint(F: mat33, constants: vec4, tau_bar: mat33):
        green = strain(F)
        second = hooke(green, constants)
        second_bar = wp.transpose(F) * tau_bar * F
        green_bar = hooke(second_bar, constants)
        through_green = real(0.5) * (F * (green_bar + wp.transpose(green_bar)))
        F_bar = tau_bar * F * wp.transpose(second) + wp.transpose(tau_bar) * F * second + through_green
        mu_bar = real(2.0) * wp.ddot(second_bar, green)
        return F_bar, vec4(mu_bar, wp.trace(green) * wp.trace(second_bar), real(0.0), real(0.0))

    return Functions(stress, stress_adjoint)


LAW = Law(build)
