"""The least Young's modulus of a part that hardly strains: were it softer, the free motion would show it.

Profile likelihood: the part's modulus is held at one value after another, and all else is fitted to the tail anew, densities that nobody told and
frequencies within what the outline leaves open among it. Softer than the bound, the misfit is larger than the best one by more than
model errors of the size seen explain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from .free_tail import RATIO_SD, Physics, Tail
from .uncertainty import spread_over_curvature

SURE = 1.645  # standard deviations: one-sided, 95 % [derived: the normal distribution]
STIFFER = (0.25, 0.75, 1.5)  # log10 of what a part may be stiffer by than fitted: the best misfit may lie there [numerical]
STEPS = (0.1, 0.2, 0.4, 0.8, 1.6)  # log10 of what it may be softer by; a part without a bound there has none [numerical]
HALVINGS = 3  # of the last step [numerical]
MOST_EVALUATIONS = 30  # of a search from the neighbouring value's end [numerical]


def lower_bounds(tail: Tail, physics: Physics, geometry_sd: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Young's moduli (n,) [Pa] that the parts `wanted` (n,) reach with 95 %; NaN for the others, and where the tail tells none.

    `geometry_sd` (n,) is the standard deviation of log10 E that the outline leaves. With other densities than those found, a softer part may explain
    the motion as well; another Poisson's ratio hardly helps it.
    """
    fitted = np.log10(physics.young)
    found = np.full(len(fitted), np.nan)
    most = (SURE * spread_over_curvature(tail, physics)) ** 2
    for part in np.flatnonzero(wanted):
        distance = softest(_profile(tail, physics, int(part)), most[part])
        found[part] = 10 ** (fitted[part] - np.hypot(distance, SURE * geometry_sd[part]))
    return found


def softest(misfit: Callable[[float], float], most: float) -> float:
    """By how much log10 E may be lower than fitted before a misfit, of the change of log10 E, is `most` above its least; NaN where none is."""
    best = min(misfit(0.0), *(misfit(change) for change in STIFFER))
    allowed, excluded = 0.0, np.nan
    for step in STEPS:
        value = misfit(-step)
        best = min(best, value)
        if value - best > most:
            excluded = step
            break
        allowed = step
    for _ in range(HALVINGS if np.isfinite(excluded) else 0):
        middle = 0.5 * (allowed + excluded)
        if misfit(-middle) - best > most:
            excluded = middle
        else:
            allowed = middle
    return excluded


def _profile(tail: Tail, physics: Physics, part: int) -> Callable[[float], float]:
    """Least chi-square of the tail and the priors on all else, with log10 E of `part` so much off what was fitted. No prior ties the part itself
    to its neighbours: they become each other's."""
    untold, parts = tail.untold, len(physics.young)
    fitted = replace(physics, density=tail.modal.density, poisson=tail.modal.poisson).vector(untold)
    first = len(fitted) - len(physics.detune)  # of the frequencies
    others = np.flatnonzero(np.arange(len(fitted)) != part)
    low, high = (bound[others] for bound in physics.bounds(untold))
    ends = {0.0: fitted[others]}  # where searches ended, by the change of log10 E

    def priors(vector: np.ndarray) -> np.ndarray:
        return np.concatenate([np.diff(np.delete(vector[:parts], part, 0), axis=0) / RATIO_SD, vector[parts:first], vector[first:]])

    by_priors = priors(np.eye(len(fitted)))[:, others]  # they are linear

    def least_misfit(change: float) -> float:
        vector = fitted.copy()
        vector[part] += change * np.log(10.0)

        def residual(free: np.ndarray) -> np.ndarray:
            vector[others] = free
            return np.r_[tail.misfit(Physics.of(vector, parts, untold)).ravel() / tail.sigma_m, priors(vector)]

        def slope(free: np.ndarray) -> np.ndarray:
            vector[others] = free
            return np.concatenate([tail.slope(Physics.of(vector, parts, untold), untold)[:, others], by_priors])

        near = ends[min(ends, key=lambda known: abs(known - change))]
        found = least_squares(residual, np.clip(near, low + 1e-9, high - 1e-9), bounds=(low, high), jac=slope, max_nfev=MOST_EVALUATIONS)
        ends[change] = found.x
        return float(2 * found.cost)

    return least_misfit
