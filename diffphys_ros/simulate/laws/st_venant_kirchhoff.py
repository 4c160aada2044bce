"""St. Venant-Kirchhoff solid: P = F S, S = 2 mu E + lam tr(E) I, E = (F^T F - I) / 2; tau = F S F^T."""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

from typing import Any

import warp as wp


def build(real: type) -> tuple[Any, Any]:
    """(stress, stress_adjoint) as Warp functions over `real` (wp.float32 or wp.float64)."""
    mat33 = wp.types.matrix((3, 3), real)

    @wp.func
    def strain(F: mat33):
        return real(0.5) * (wp.transpose(F) * F - wp.identity(3, dtype=real))

    @wp.func
    def stress(F: mat33, mu: real, lam: real):
        green = strain(F)
        second = real(2.0) * mu * green + lam * wp.trace(green) * wp.identity(3, dtype=real)
        return F * second * wp.transpose(F)

    @wp.func
    def stress_adjoint(F: mat33, mu: real, lam: real, tau_bar: mat33):
        unit = wp.identity(3, dtype=real)
        green = strain(F)
        second = real(2.0) * mu * green + lam * wp.trace(green) * unit
        second_bar = wp.transpose(F) * tau_bar * F
        green_bar = real(2.0) * mu * second_bar + lam * wp.trace(second_bar) * unit
        through_green = real(0.5) * (F * (green_bar + wp.transpose(green_bar)))
        F_bar = tau_bar * F * wp.transpose(second) + wp.transpose(tau_bar) * F * second + through_green
        return F_bar, real(2.0) * wp.ddot(second_bar, green), wp.trace(green) * wp.trace(second_bar)

    return stress, stress_adjoint
