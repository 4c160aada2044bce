"""Where on the body a force acts: on all of it or about a place, by how probable the motion makes each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from ..differences import differences
from ..footprints import Footprint
from ..linear_systems import inverted
from .force import ForceProblem
from .free_tail import Physics

WIND = 0.3  # probability of a uniform force from which on it is taken: of 30 runs of choice clips all 16 of winds have more (.62 to .98) and all 14 of pushes less (0 to .13) [docs/measurements/choices.md]
TOUCH = 0.2  # widest place, over the body's length, that speaks against a wind: a wider one hardly differs, and errors of the modes make it the better of the two for most winds [chosen]
USUAL, SPREAD = 0.1, 0.5  # width of a push over the body's length, and the standard deviation of its logarithm: errors of the modes make wide places the better, and a push the larger [chosen]
SURE = 0.1  # square of what a frame misses at the least, over its sigma, where the second order is left open: then a wind and a push may both miss hardly anything [chosen]
SHAPES = 2.0  # in which what is missed of a quarter period differs: 1.1 to 6 by its principal components, 3 in the median of those clips [docs/measurements/choices.md]
MOST_INDEPENDENT = 30.0  # numbers that what is missed holds: errors of the modes repeat from period to period, so that more of them tell no more [docs/measurements/choices.md]
EVEN = 0.5  # probability of a uniform force before the motion is looked at [chosen]
NEARBY_SD = np.array([0.1, 0.1, 0.5])  # of centre, over the body's length, and log width about what was found: as far as the next places that are tried [derived]
QUARTER = 0.25  # of a leading period: frames that miss the same [chosen]
SLOWEST_HZ = 1e-3  # that counts as a swing [numerical]
NARROWEST, WIDEST = 0.04, 2.0  # widths that the search may come to, over the body's length: half of the least that is tried; hardly to be told from uniform [derived]
FIRST_MOVES = (0.06, 0.06, 0.25)  # of the search: centre, over the body's length, and log width; less than the starts lie apart [numerical]
FOOTPRINT_STEPS, FOOTPRINT_EXACT = 80, 1e-3  # most of the search; where it ends, of the length and of the cost [numerical]


def best_footprint(problem: ForceProblem, physics: Physics) -> Footprint:
    """Uniform where that is not improbable beside pushes of a small place, else the Gaussian footprint that motion and usual widths make the likeliest."""
    places = [Footprint(), *problem.local_footprints]
    costs = np.array([_cost(problem, physics, each) for each in places])
    best, between = between_tried(problem, physics, places[1:], costs[1:])
    places[1 + best], costs[1 + best] = between, _cost(problem, physics, between)
    small = np.r_[True, touches(problem, places[1:])]
    likely = before(problem, places)
    if probabilities(unlikely(problem, physics, costs[small]), likely[small], 1.0)[0] > WIND:
        return Footprint()
    local = unlikely(problem, physics, costs[1:]) - 2 * np.log(likely[1:])
    return nearby(problem, physics, places[1 + int(local.argmin())])


def between_tried(problem: ForceProblem, physics: Physics, local: Sequence[Footprint], costs: np.ndarray, *, missed: float = 0.0) -> tuple[int, Footprint]:
    """Which small one of local places with these costs, (n,), is the likeliest, and the likeliest near it: a push that lies between those that are tried passes
    for a wind else. `missed` as for `unlikely`."""
    odd = unlikely(problem, physics, costs, missed=missed) + [odd_width(problem, each) for each in local]
    best = int(np.where(touches(problem, local), odd, np.inf).argmin())
    return best, nearby(problem, physics, local[best], widest=TOUCH, missed=missed)


def touches(problem: ForceProblem, places: Sequence[Footprint]) -> np.ndarray:
    """Which local places are small enough to speak against a wind, bool (n,)."""
    return np.array([each.parameters[2] < TOUCH * problem.extent[2] for each in places])


def odd_width(problem: ForceProblem, push: Footprint) -> float:
    """Twice the negative log probability of a push's width before the motion is looked at; none of the usual one's."""
    return float((np.log(push.parameters[2] / (USUAL * problem.extent[2])) / SPREAD) ** 2)


def before(problem: ForceProblem, places: Sequence[Footprint]) -> np.ndarray:
    """Probabilities (n,) of a uniform force, which comes first, and of local ones, as usual as their widths, before the motion is looked at."""
    usual = np.exp([-0.5 * odd_width(problem, each) for each in places[1:]])
    return np.r_[EVEN, (1 - EVEN) * usual / usual.sum()]


def probabilities(costs: np.ndarray, before: np.ndarray, unit: float) -> np.ndarray:
    """Of explanations with costs (n,), whose log likelihood falls by half for a `unit` of them, and probabilities before, (n,), or what these are to each other."""
    logs = np.log(before) - 0.5 * (costs - costs.min()) / unit
    weight = np.exp(logs - logs.max())
    return np.asarray(weight / weight.sum())


def unlikely(problem: ForceProblem, physics: Physics, costs: np.ndarray, *, missed: float = 0.0) -> np.ndarray:
    """Twice the negative log likelihood (n,) of explanations with sums of squared residuals that count (n,), where nobody told how much is missed of a frame beyond a
    square of `missed`, over its sigma: frames of a quarter period miss the same, in SHAPES ways."""
    return independent(problem, physics) * np.log(costs / problem.known.sum() + _least(problem, missed))


def _least(problem: ForceProblem, missed: float) -> float:
    """Square of what a frame misses at the least, over its sigma."""
    return missed if problem.swing is None else max(missed, SURE)


def independent(problem: ForceProblem, physics: Physics) -> float:
    """How many independent numbers what is missed of a motion holds."""
    return min(SHAPES * int(problem.known.sum()) / max(QUARTER * leading_frames(problem, physics), 1.0), MOST_INDEPENDENT)


def open_nearby(problem: ForceProblem, physics: Physics, footprint: Footprint, *, missed: float = 0.0) -> list[Footprint]:
    """Footprints one standard deviation from a Gaussian one that was found, in independent combinations of its centre and log width; none of a uniform
    one. `missed` as for `unlikely`."""
    if footprint.family == "uniform":
        return []
    unit = np.r_[np.full(2, problem.extent[2]), 1.0]
    found = np.r_[footprint.parameters[:2], np.log(footprint.parameters[2])] / unit

    def counted(p: np.ndarray) -> np.ndarray:
        return problem.counted(problem.solve_under(physics, _gaussian(p * unit)))

    slope, cost = differences(counted, found), float((counted(found) ** 2).sum())
    told = independent(problem, physics) / (cost + _least(problem, missed) * problem.known.sum()) * slope.T @ slope
    size, axes = np.linalg.eigh(inverted(told + np.diag(NEARBY_SD**-2)))
    return [_gaussian((found + step) * unit) for step in (axes * np.sqrt(size)).T]


def _gaussian(p: np.ndarray) -> Footprint:
    """Of the centre [m] and the log of the width [m]."""
    return Footprint("gaussian", np.r_[p[:2], np.exp(p[2])])


def leading_frames(problem: ForceProblem, physics: Physics) -> float:
    """Frames of a leading period."""
    return 1 / (max(float(problem.modal.frequencies(physics.young)[0]), SLOWEST_HZ) * problem.period_s)


def _cost(problem: ForceProblem, physics: Physics, footprint: Footprint) -> float:
    return problem.counted_cost(problem.solve_under(physics, footprint, freely=problem.swing is not None))


def nearby(problem: ForceProblem, physics: Physics, begun: Footprint, *, widest: float = WIDEST, missed: float = 0.0) -> Footprint:
    """The likeliest Gaussian footprint in the neighbourhood of one, no wider than `widest` times the body's length; `missed` as for `unlikely`."""
    low, high, length = problem.extent

    def improbable(p: np.ndarray) -> float:
        if not ((p[:2] >= low).all() and (p[:2] <= high).all() and NARROWEST < np.exp(p[2]) / length < widest):
            return np.inf
        push = _gaussian(p)
        return float(unlikely(problem, physics, np.array(_cost(problem, physics, push)), missed=missed)) + odd_width(problem, push)

    start = np.r_[begun.parameters[:2], np.log(begun.parameters[2])]
    simplex = start + np.vstack([np.zeros(3), np.diag(FIRST_MOVES) * (length, length, 1.0)])
    ends = {"maxiter": FOOTPRINT_STEPS, "xatol": FOOTPRINT_EXACT * length, "fatol": FOOTPRINT_EXACT}
    found = minimize(improbable, start, method="Nelder-Mead", options={"initial_simplex": simplex, **ends}).x
    return _gaussian(found)
