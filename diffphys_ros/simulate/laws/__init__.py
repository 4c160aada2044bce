"""Constitutive laws: one file each, one line here.

A law is a callable `build(real)` that returns two Warp functions of the given scalar type:

- `stress(F, mu, lam)` -> Kirchhoff stress tau = P F^T [Pa];
- `stress_adjoint(F, mu, lam, tau_bar)` -> (F_bar, mu_bar, lam_bar): the product of `tau_bar` with its derivatives;

and, where the material flows, two more:

- `project(F_trial, mu, lam)` -> the elastic F of a substep that would have led to F_trial;
- `project_adjoint(F_trial, mu, lam, F_bar)` -> (F_trial_bar, mu_bar, lam_bar).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from . import neo_hookean, st_venant_kirchhoff

LAWS: dict[str, Callable[[type], tuple[Any, ...]]] = {
    "neo_hookean": neo_hookean.build,
    "st_venant_kirchhoff": st_venant_kirchhoff.build,
}


class Law(NamedTuple):
    """The Warp functions of one law over one scalar type; None where the substep leaves a step out."""

    stress: Any
    stress_adjoint: Any
    project: Any = None
    project_adjoint: Any = None


def law_of(name: str, real: type) -> Law:
    """The law of a name in LAWS."""
    return Law(*LAWS[name](real))
