"""Compressible neo-Hookean solid: tau = mu (F F^T - I) + lam log(J) I (Bonet and Wood, eq. 6.28)."""

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

from typing import Any

import warp as wp


def build(real: type) -> tuple[Any, Any]:
    """(stress, stress_adjoint) as Warp functions over `real` (wp.float32 or wp.float64)."""
    mat33 = wp.types.matrix((3, 3), real)

    @wp.func
    def stress(F: mat33, mu: real, lam: real):
        unit = wp.identity(3, dtype=real)
        return mu * (F * wp.transpose(F) - unit) + lam * wp.log(wp.determinant(F)) * unit

    @wp.func
    def stress_adjoint(F: mat33, mu: real, lam: real, tau_bar: mat33):
        log_j = wp.log(wp.determinant(F))
        pressure_bar = wp.trace(tau_bar)
        F_bar = mu * ((tau_bar + wp.transpose(tau_bar)) * F) + (lam * pressure_bar) * wp.transpose(wp.inverse(F))
        mu_bar = wp.ddot(tau_bar, F * wp.transpose(F)) - pressure_bar
        return F_bar, mu_bar, log_j * pressure_bar

    return stress, stress_adjoint
