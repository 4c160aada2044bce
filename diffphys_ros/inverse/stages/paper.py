"""The published schedule (paper section 3.5, appendix D): the force frame by frame at the prior's material, then both over the whole clip."""

from __future__ import annotations

from collections.abc import Collection

from ...errors import InputError
from ..descent import Rules
from ..problem import Problem
from .fields import MEMORY
from .stage import Stage


def paper(problem: Problem) -> list[Stage]:
    """Stages over fields alone: no constants per part, no vectors per frame. What fit.hold names of young and force stays away. Raises
    InputError where it names both, or no pictures count."""
    if not problem.plan.simulates:
        return []
    experiment, held = problem.settings.experiment, problem.layout.held
    require_sought(held)
    frame_by_frame, whole_clip = Rules(patience=None), Rules(memory=MEMORY)  # which ends where nothing is gained any more
    if "pixels" not in problem.objective.evidence:
        raise InputError("experiment.image_weight is 0, must be above 0 with the schedule paper, which knows pictures alone; raise it")
    force: tuple[str, ...] = () if "force" in held else ("force_field",)
    material: tuple[str, ...] = () if "young" in held else ("material_field",)
    found = []
    if force and experiment.transition_iterations and problem.settings.fit.force_field == "voxels":
        found.append(Stage("frames", force, len(problem.prepared.clip) - 1, frame_by_frame, fields=True, way="transitions"))
    warm_up = round(experiment.warm_up_share * experiment.field_iterations) if force and material else 0
    if warm_up:
        found.append(Stage("fields", force, warm_up, whole_clip, fields=True))
    return [*found, Stage("fields", (*force, *material), experiment.field_iterations - warm_up, whole_clip, fields=True)]


def require_sought(held: Collection[str]) -> None:
    """Raises InputError where the blocks that are held leave nothing to seek."""
    if {"young", "force"} <= set(held):
        raise InputError("fit.hold holds young and force, with the schedule paper one of them must be sought; leave one out")
