"""Constants per part and one vector per frame, from the linear engine's answer and with its curvature as the metric."""

from __future__ import annotations

import numpy as np

from ..descent import Rules
from ..problem import Problem
from .stage import Stage

LONGEST = {"young": 0.4, "damping": 1.0}  # of a step, in log E and in units of damping


def constants(problem: Problem) -> list[Stage]:
    """One stage in which everything that is not held is free."""
    rules = Rules(problem.metric, limit=lambda at, step: allowed(problem, at, step))
    return [Stage("fit", problem.layout.free, problem.plan.iterations + 1, rules)]


def allowed(problem: Problem, at: np.ndarray, step: np.ndarray) -> float:
    """Share of a step (k,) of the free blocks that keeps log E and damping within reach: LONGEST, and what experiment.max_substeps can carry."""
    z, moved, index = problem.layout.start.copy(), np.zeros(problem.layout.size), problem.layout.index(problem.layout.free)
    z[index], moved[index] = at, step
    longest = [np.abs(moved[problem.layout.slices[name]]).max(initial=0.0) / most for name, most in LONGEST.items()]
    share = min(1.0, 1.0 / max(*longest, 1e-12))
    for rise, left in zip(moved[problem.layout.slices["young"]] * share, room(problem, z), strict=True):
        if rise > left:
            share *= max(left, 0.0) / rise
    return share


def room(problem: Problem, z: np.ndarray) -> np.ndarray:
    """How far log E per part may still rise (n,) before experiment.max_substeps no longer carry it."""
    return np.log(problem.forward.simulator.max_young(problem.settings.experiment.max_substeps) / problem.layout.young_of(z))
