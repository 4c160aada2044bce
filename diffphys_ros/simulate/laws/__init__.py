"""Constitutive laws: one file each, one line here.

A law is a callable `build(real)` that returns two Warp functions of the given scalar type:

- `stress(F, mu, lam)` -> Kirchhoff stress tau = P F^T [Pa];
- `stress_adjoint(F, mu, lam, tau_bar)` -> (F_bar, mu_bar, lam_bar): the product of `tau_bar` with its derivatives.
"""

from collections.abc import Callable
from typing import Any

from . import neo_hookean, st_venant_kirchhoff

LAWS: dict[str, Callable[[type], tuple[Any, Any]]] = {
    "neo_hookean": neo_hookean.build,
    "st_venant_kirchhoff": st_venant_kirchhoff.build,
}
