"""What a fit does, one after the other: a file for each list of stages."""

from __future__ import annotations

from collections.abc import Callable

from ...config import Settings
from ...errors import InputError, short
from ..problem import Problem
from ..resolution import fields_wanted
from ..unknowns import checked_hold
from .constants import constants
from .fields import fields
from .linear import linear
from .paper import paper, require_sought
from .stage import Stage

__all__ = ["SCHEDULES", "Stage", "require_schedule", "schedule"]


def simulated(problem: Problem) -> list[Stage]:
    """Constants per part and a vector per frame, then fields where they are asked for; nothing where nothing can be simulated."""
    if not problem.plan.simulates:
        return []
    return [*constants(problem), *(fields(problem) if fields_wanted(problem.settings) else [])]


SCHEDULES: dict[str, Callable[[Problem], list[Stage]]] = {**dict.fromkeys(("auto", "modes", "joint"), simulated), "linear": linear, "paper": paper}


def require_schedule(settings: Settings) -> None:
    """Raises InputError where experiment.schedule names none, or fit.hold no unknowns or those that it must seek."""
    if (name := settings.experiment.schedule) not in SCHEDULES:
        raise InputError(f"experiment.schedule: {short(name)} is unknown; choose one of {', '.join(SCHEDULES)}")
    held = checked_hold(settings.fit.hold)
    if settings.experiment.published:
        require_sought(held)


def schedule(problem: Problem) -> list[Stage]:
    """The stages of a problem, as experiment.schedule names them. Raises InputError."""
    require_schedule(problem.settings)
    return SCHEDULES[problem.settings.experiment.schedule](problem)
