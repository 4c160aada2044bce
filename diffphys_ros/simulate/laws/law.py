"""What a constitutive law is made of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

CONSTANTS = 4  # numbers that a law has of a particle
VISCOSITY = "viscosity_pa_s"  # name of the parameter that bounds the time step of a viscous law


class Functions(NamedTuple):
    """Warp functions of a law over one scalar type; None where the substep leaves a step out.

    `constants` is a 4-vector of one particle: mu and lam [Pa] and up to two parameters of the law's own. An adjoint
    takes the arguments of its function and the adjoint of the result, and returns those of the arguments in order.
    """

    stress: Any  # (F, constants) -> Kirchhoff stress tau = P F^T [Pa]
    stress_adjoint: Any  # (F, constants, tau_bar) -> F_bar, constants_bar
    project: Any = None  # (F_trial, constants) -> F: what is left of a substep's deformation once the material has flowed
    project_adjoint: Any = None  # (F_trial, constants, F_bar) -> F_trial_bar, constants_bar
    viscous_stress: Any = None  # (F, C, constants) -> Kirchhoff stress [Pa] of the velocity gradient C [1/s]
    viscous_stress_adjoint: Any = None  # (F, C, constants, tau_bar) -> F_bar, C_bar, constants_bar


@dataclass(frozen=True)
class Parameter:
    """A constant that a law has beside mu and lam."""

    name: str  # ends in its unit
    default: float
    low: float  # smallest value allowed
    high: float  # largest value allowed
    doc: str


@dataclass(frozen=True)
class Law:
    """A constitutive law."""

    build: Callable[[type], Functions]  # for wp.float32 or wp.float64
    parameters: tuple[Parameter, ...] = ()  # the third and fourth entry of `constants`
    elastic: bool = True  # all deformation is stored as energy: the body has a rest shape to vibrate about
