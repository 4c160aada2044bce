"""What a fit does, one after the other: a file for each list of stages."""

from __future__ import annotations

from collections.abc import Callable

from ...config import Settings
from ...errors import InputError, short
from ..problem import Problem
from ..resolution import fields_wanted
from .constants import constants
from .fields import fields
from .linear import linear
from .paper import paper
from .stage import Stage

__all__ = ["SCHEDULES", "Stage", "require_schedule", "schedule"]


def simulated(problem: Problem) -> list[Stage]:
    """Constants per part and a vector per frame, then fields where they are asked for; nothing where nothing can be simulated."""
    if not problem.plan.simulates:
        return []
    return [*constants(problem), *(fields(problem) if fields_wanted(problem.settings) else [])]


SCHEDULES: dict[str, Callable[[Problem], list[Stage]]] = {**dict.fromkeys(("auto", "modes", "joint"), simulated), "linear": linear, "paper": paper}


def require_schedule(settings: Settings) -> None:
    """Raises InputError where experiment.schedule names none."""
    if (name := settings.experiment.schedule) not in SCHEDULES:
        raise InputError(f"experiment.schedule: {short(name)} is unknown; choose one of {', '.join(SCHEDULES)}")


def schedule(problem: Problem) -> list[Stage]:
    """The stages of a problem, as experiment.schedule names them. Raises InputError."""
    require_schedule(problem.settings)
    return SCHEDULES[problem.settings.experiment.schedule](problem)
