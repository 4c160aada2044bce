"""Constants per part and one vector per frame by the linear engine alone, against the tracks: seconds, for motions that are small."""

from __future__ import annotations

from ..descent import Rules
from ..problem import Problem
from .stage import Stage

STATES = 30


def linear(problem: Problem) -> list[Stage]:
    """One stage over everything that is not held."""
    return [Stage("fit", problem.layout.free, STATES, Rules(problem.metric), engine="modes", evidence=("tracks",))]
