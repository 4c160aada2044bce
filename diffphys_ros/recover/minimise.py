"""Quasi-Newton minimisation (BFGS) from a given Hessian.

The start Hessian comes from the linear modal model (Gauss-Newton), so that the first steps are near-Newton steps although
only gradients of the simulation are known; BFGS then learns what the linear model does not say. Nocedal and Wright,
Numerical Optimization, chapter 6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

SHRINK = 0.3  # of a rejected step
TRIES = 4  # steps of decreasing length before the search gives up
ARMIJO = 1e-4
FLAT = 5e-3  # relative decrease that counts as no progress


class Evaluation(Protocol):
    """The objective at one point; the gradient is computed only when asked for."""

    @property
    def value(self) -> float:
        """The objective."""
        ...

    def gradient(self) -> np.ndarray:
        """d(value)/dz, (size,)."""
        ...


@dataclass(frozen=True)
class Iterate:
    """State of the search: everything that a checkpoint must hold."""

    z: np.ndarray  # (size,)
    value: float
    gradient: np.ndarray  # (size,)
    inverse: np.ndarray  # inverse Hessian, (size, size)
    iteration: int = 0
    flat: int = 0  # iterations in a row without progress
    history: tuple[float, ...] = ()  # accepted values

    @property
    def finished(self) -> bool:
        """Whether going on is pointless."""
        return self.flat >= 2


def begin(evaluate: Callable[[np.ndarray], Evaluation], z: np.ndarray, hessian: np.ndarray) -> Iterate:
    """Iterate 0 at z with the inverse of a positive definite Hessian."""
    here = evaluate(z)
    return Iterate(z, here.value, here.gradient(), np.linalg.inv(hessian), history=(here.value,))


def lost(z: np.ndarray) -> Iterate:
    """A search that cannot begin at z, because the objective has no value there: finished, and no better than anything."""
    return Iterate(z, np.inf, np.zeros_like(z), np.eye(len(z)), flat=2, history=(np.inf,))


def minimise(
    evaluate: Callable[[np.ndarray], Evaluation], state: Iterate, *, iterations: int, limit: Callable[[np.ndarray, np.ndarray], float]
) -> Iterator[Iterate]:
    """Yields one Iterate per iteration until `iterations` or no progress. `limit(z, step)` says which share of a step
    is allowed (0..1]."""
    while state.iteration < iterations and not state.finished:
        state = _advance(evaluate, state, limit)
        yield state


def _advance(evaluate: Callable, state: Iterate, limit: Callable) -> Iterate:
    step = -state.inverse @ state.gradient
    step = step * limit(state.z, step)
    slope, share = float(state.gradient @ step), 1.0
    for _ in range(TRIES):
        here = evaluate(state.z + share * step)
        if np.isfinite(here.value) and here.value <= state.value + ARMIJO * share * slope:
            return _accept(state, share * step, here)
        share *= _shrink(state.value, here.value, share * slope)
    return replace(state, iteration=state.iteration + 1, flat=2)


def _shrink(before: float, after: float, slope: float) -> float:
    """Minimum of the parabola through both values and the slope, kept within sane shares."""
    curvature = after - before - slope
    if not np.isfinite(after) or curvature <= 0:
        return SHRINK
    return float(np.clip(-slope / (2 * curvature), 0.1, 0.6))


def _accept(state: Iterate, step: np.ndarray, here: Evaluation) -> Iterate:
    gradient = here.gradient()
    progress = (state.value - here.value) > FLAT * abs(state.value)
    return Iterate(
        state.z + step,
        here.value,
        gradient,
        update_inverse(state.inverse, step, gradient - state.gradient),
        state.iteration + 1,
        0 if progress else state.flat + 1,
        (*state.history, here.value),
    )


def update_inverse(inverse: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """BFGS update of the inverse Hessian by a step and the change of the gradient along it; skipped without curvature."""
    curvature = float(step @ change)
    if curvature <= 1e-10 * np.linalg.norm(step) * np.linalg.norm(change):
        return inverse
    left = np.eye(len(step)) - np.outer(step, change) / curvature
    return left @ inverse @ left.T + np.outer(step, step) / curvature
