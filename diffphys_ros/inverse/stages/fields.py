"""Fields with many parameters, from where constants and vectors have ended (paper section 3.5, A.12).

First the force alone while the material stays as it is, then both: a force that may do anything would else explain the motion
at any stiffness. What constants ended with is the start, so that a field only has to say what they do not.
"""

from __future__ import annotations

from ..descent import Rules
from ..problem import Problem
from .stage import Stage

WARM_UP = 0.25  # share of the iterations in which the material rests, where no such force has been fitted before
MEMORY = 15  # steps whose curvature is remembered


def fields(problem: Problem) -> list[Stage]:
    """A stage for the force, and one for force and material; a field whose block is held stays away."""
    fit, experiment, held = problem.settings.fit, problem.settings.experiment, problem.layout.held
    rest = tuple(name for name in ("damping", "motion") if name not in held)
    force = () if "force" in held else ("force_field",)
    material = () if "young" in held else ("material_field",)
    warm_up = 0 if fit.force_field == "frame" or not force or not material else round(WARM_UP * experiment.field_iterations)
    rules = Rules(memory=MEMORY, patience=None)
    stages = [Stage("fields", (*force, *rest), warm_up, rules, fields=True, spare=2.0)] if warm_up else []
    return [*stages, Stage("fields", (*force, *rest, *material), experiment.field_iterations - warm_up, rules, fields=True, spare=2.0)]
