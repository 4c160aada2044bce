"""How many substeps a frame needs, how stiff a given number allows, and what to say when a simulation left its bounds."""

from __future__ import annotations

import math

import numpy as np

from ..errors import InputError, SimulationError
from .substep.forward import INVERTED, LEFT_GRID

CFL = 0.5  # c_p dt / dx
DIFFUSION = 0.25  # viscosity dt / (density dx^2); explicit transfers blow up at 0.4 to 0.6
YOUNG_MARGIN = 1.5  # substeps are chosen for this times the stiffest Young's modulus of the moment


def wave_speed(young: np.ndarray | float, poisson: np.ndarray | float, density: np.ndarray | float) -> np.ndarray:
    """Speed of pressure waves [m/s] of an isotropic solid: sqrt(E (1 - nu) / ((1 + nu) (1 - 2 nu) rho))."""
    young, nu, rho = (np.asarray(a, float) for a in (young, poisson, density))
    with np.errstate(divide="ignore", invalid="ignore"):  # callers check for finite speeds
        return np.sqrt(young * (1 - nu) / ((1 + nu) * (1 - 2 * nu) * rho))


def substeps_per_frame(
    young: np.ndarray | float,
    poisson: np.ndarray | float,
    density: np.ndarray | float,
    *,
    dx: float,
    period_s: float,
    margin: float = YOUNG_MARGIN,
    viscosity_pa_s: float = 0.0,
) -> int:
    """ceil(c_p period / (CFL dx)) at `margin` times the stiffest of Young's moduli [Pa]; more where a viscous stress asks for it.

    Raises InputError.
    """
    speed = wave_speed(np.asarray(young, float) * margin, poisson, density)
    if not np.all(np.isfinite(speed) & (speed > 0)):
        raise InputError(
            "substeps: Young's modulus and density must be positive and Poisson's ratio in 0 .. 0.5 (exclusive); correct the start values"
        )
    waves = float(speed.max()) * period_s / (CFL * dx)
    diffusion = viscosity_pa_s * period_s / (DIFFUSION * float(np.min(density)) * dx**2)
    return max(1, math.ceil(max(waves, diffusion) - 1e-9))


def max_young(substeps: int, poisson: np.ndarray | float, density: np.ndarray | float, *, dx: float, period_s: float) -> np.ndarray:
    """Largest Young's modulus [Pa] that `substeps` per frame carry at CFL 0.5: the inverse of substeps_per_frame at margin 1."""
    nu, rho = np.asarray(poisson, float), np.asarray(density, float)
    speed = substeps * CFL * dx / period_s
    return speed**2 * (1 + nu) * (1 - 2 * nu) * rho / (1 - nu)


def max_viscosity(substeps: int, density: np.ndarray | float, *, dx: float, period_s: float) -> float:
    """Largest dynamic viscosity [Pa s] that `substeps` per frame carry."""
    return DIFFUSION * float(np.min(density)) * dx**2 * substeps / period_s


def raise_for_flag(
    code: int,
    *,
    particles: int,
    frame: int,
    substeps: int,
    where: np.ndarray,
    stiffest: float,
    allowed: float,
    simulation: int | None = None,
) -> None:
    """SimulationError for the flag of a frame: `where` is the particle's last position [m], `stiffest` and `allowed`
    are the largest Young's modulus present and the largest that these substeps carry [Pa]; `simulation` of a batch. A frame
    before the first is one in which the body settles under gravity."""
    index, reason = divmod(code, 4)
    substep, particle = divmod(index, particles)
    of_batch = "" if simulation is None else f"simulation {simulation}, "
    when = f"frame {frame}" if frame >= 0 else f"settling under gravity, {-frame} frames before frame 0"
    place = of_batch + f"{when}, substep {substep} of {substeps}, particle {particle}"
    point = ", ".join(f"{c:.4g}" for c in where)
    if stiffest > allowed:
        cure = f"lower Young's modulus from {stiffest:.3g} below {allowed:.3g} Pa or raise the substeps"
    elif frame < 0:
        cure = "raise Young's modulus of the softest part, which does not carry its own weight"
    else:
        cure = "lower the force or the start velocity, or raise Young's modulus of the softest part"
    if reason == LEFT_GRID:
        raise SimulationError(f"{place}: the particle left the grid near ({point}) m; {cure}, or give the grid more reach")
    if reason == INVERTED:
        raise SimulationError(f"{place}: the material turned inside out (det F <= 0) near ({point}) m; {cure}")
    raise SimulationError(f"{place}: the state is no longer finite; {cure}")
