"""Dotted names and values -> the tree, and back."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping
from typing import Any

from ..errors import InputError, short
from .leaf import leaves
from .moved import moved
from .tree import Experiment, PriorSettings, Scene, Settings

IN_PICTURE = {"clamp_box_m": "clamp_px", "floor_z_m": "floor_px", "gravity_m_s2": "down_px"}  # of scene: what is told in the world, and the same in the picture
LINES = ("clamp_px", "length_px", "floor_px")
SHORTEST_PX = 2.0  # of a line: nearer points have no direction
WEIGHTS = ("experiment.track_weight", "experiment.image_weight", "experiment.depth_weight")  # of everything that is seen


def build(values: Mapping[str, Any], origin: str = "settings") -> Settings:
    """Settings from dotted names; checks every value. Raises InputError that names origin, setting and bound."""
    known, groups = leaves(), {}  # type: ignore[var-annotated]
    for name, value in values.items():
        if name not in known:
            where = moved(name) if isinstance(name, str) else ""
            raise InputError(f"{origin}: {name} {where}" if where else f"{origin}: unknown setting {short(name)}{_nearest(str(name))}")
        group, key = name.split(".")
        groups.setdefault(group, {})[key] = known[name].checked(value, origin)
    settings = Settings(**{g.name: g.default_factory(**groups.get(g.name, {})) for g in dataclasses.fields(Settings)})  # type: ignore[operator]
    _require_evidence(settings.experiment, origin)
    _require_one_prior(settings.prior, origin)
    _require_direction(settings.scene, origin)
    _require_one_density(settings.scene, origin)
    _require_said_once(settings.scene, origin)
    return settings


def flat(settings: Settings) -> dict[str, Any]:
    """Dotted names and values of a tree; build(flat(s)) == s."""
    return {f"{g}.{k}": v for g, group in dataclasses.asdict(settings).items() for k, v in group.items()}


def _require_evidence(experiment: Experiment, origin: str) -> None:
    """With no term of the loss nothing would be fitted, and the start values would pass for an answer."""
    if not any(getattr(experiment, name.partition(".")[2]) for name in WEIGHTS):
        raise InputError(f"{origin}: {', '.join(WEIGHTS)} are all 0, so that nothing would be fitted; give at least one of them a weight, such as 1")


def _require_one_prior(prior: PriorSettings, origin: str) -> None:
    """Names may stand beside a model, which may not answer; a file may not, one of the two would be lost."""
    other = next((name for name in ("materials", "base_url", "model") if getattr(prior, name)), None)
    if prior.file and other is not None:
        raise InputError(f"{origin}: prior.file and prior.{other} are both given, must be one prior; leave one out, or set it to null")


def _require_direction(scene: Scene, origin: str) -> None:
    if scene.thickness_axis is not None and not any(scene.thickness_axis):
        raise InputError(f"{origin}: scene.thickness_axis is {short(scene.thickness_axis)}, must have a direction; give a world axis such as [0, 1, 0]")


def _require_one_density(scene: Scene, origin: str) -> None:
    """Densities of several parts may stand beside a mass, which scales them; a single one would be ignored."""
    if scene.mass_kg is not None and scene.density_kg_m3 is not None and len(scene.density_kg_m3) == 1:
        raise InputError(f"{origin}: scene.mass_kg and scene.density_kg_m3 are both given, one follows from the other; leave one out, or give a density per part")


def _require_said_once(scene: Scene, origin: str) -> None:
    """Of what is told in metres and in pixels, one would be ignored; two equal points are no line."""
    for metric, pictured in IN_PICTURE.items():
        if getattr(scene, metric) is not None and getattr(scene, pictured) is not None:
            raise InputError(f"{origin}: scene.{metric} and scene.{pictured} are both given and say the same; leave one out, or set it to null")
    for name in LINES:
        line = getattr(scene, name)
        if line is not None and math.dist(line[:2], line[2:]) < SHORTEST_PX:
            raise InputError(f"{origin}: scene.{name} is {short(line)}, its points must be at least {SHORTEST_PX:g} px apart; give two points as [[u, v], [u, v]]")
    if scene.down_px is not None and not any(scene.down_px):
        raise InputError(f"{origin}: scene.down_px is {short(scene.down_px)}, must have a direction; [0, 1] is straight down")


def _nearest(name: str) -> str:
    close = difflib.get_close_matches(name[:100], leaves(), 1, 0.4)
    return f"; did you mean {close[0]!r}?" if close else "; the known groups are " + ", ".join(f.name for f in dataclasses.fields(Settings))
