"""A modulus per zone where the settings ask for a field: what the fit starts from, and back to the parts that were seen."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..config import Settings
from ..progress import Progress
from ..start.values import WIDEST_SD
from ..start.zones import Zoned, zone_values
from ..types import Recovery
from .material_prior import on_points
from .prepared import Prepared

WITHOUT_ELEMENTS = "scikit-fem is not installed and the clip was prepared without zones: the field begins at constants per part"

MISSED = "no modulus per zone is told by the free motion: the field begins at constants per part"


def zones_of(prepared: Prepared, settings: Settings) -> Generator[Progress, None, Zoned | None]:
    """Zones of a clip whose material is wanted as a field; those that it carries are kept. None where constants per part are
    wanted, no free tail tells of stiffness, zones do not explain the motion, or finite elements are not at hand."""
    if settings.fit.material_field == "part" or not prepared.start.has_free_tail or settings.experiment.schedule == "joint":
        return None
    if prepared.zones is not None:
        return prepared.zones
    yield Progress("modes", text="material as a field: a modulus per zone from the eigenmodes")
    try:
        found = _found(prepared, settings)
    except ModuleNotFoundError as error:
        if error.name != "skfem":
            raise
        yield Progress("modes", text=WITHOUT_ELEMENTS)
        return None
    if not found.start.identified.any():
        yield Progress("modes", text=f"{MISSED} ({found.start.reasons[0]})")
        return None
    yield Progress("modes", text=described(found))
    return found


def _found(prepared: Prepared, settings: Settings) -> Zoned:
    body, clip, prior = prepared.body, prepared.clip, prepared.prior
    pattern = None if prior is None else lambda points: on_points(prior, body, clip.camera, points)[0]
    return zone_values(body, prepared.tracks, clip.period_s, settings, prepared.start, camera=clip.camera, pattern=pattern)


def described(zones: Zoned) -> str:
    """The zones in a line for people, from the clamp outwards."""
    values = ", ".join(f"{e:.3g} (x/ {10**s:.2f})" for e, s in zip(zones.start.young, zones.start.log10_young_sd, strict=True))
    return f"{len(zones.part)} zones: E = {values} Pa; misfit {100 * np.sqrt(zones.start.track_cost):.1f} %"


def divided(prepared: Prepared, zones: Zoned | None) -> Prepared:
    """The clip with the zones as its parts."""
    if zones is None:
        return replace(prepared, zones=None)
    return replace(prepared, body=zones.body, start=zones.start, modal=zones.modal, zones=zones)


def in_parts(recovery: Recovery, zones: Zoned | None) -> Recovery:
    """The answer with the parts that were seen in place of the zones; a part is identified where most of its volume is."""
    if zones is None:
        return recovery
    zone = recovery.part - 1
    part = zones.part[zone]
    told = recovery.identified[zone] & (recovery.log10_young_sd <= WIDEST_SD)
    numbers = range(1, int(zones.part.max()) + 1)
    share = np.array([np.average(told[part == n], weights=recovery.volume[part == n]) if (part == n).any() else 0.0 for n in numbers])
    reasons = tuple(_reason(recovery, part == n, s) for n, s in zip(numbers, share, strict=True))
    per_zone = {name: recovery.metrics[name] for name in ("young_start_pa", "young_refined_pa")}
    means = {name: _part_means(values, zones.part) for name, values in per_zone.items()}
    zone_metrics = {"part": zones.part.tolist(), "log10_young_sd": zones.start.log10_young_sd.tolist(), **per_zone}
    return replace(recovery, part=part, identified=share > 0.5, reasons=reasons, metrics=recovery.metrics | means | {"zones": zone_metrics})


def _reason(recovery: Recovery, here: np.ndarray, share: float) -> str:
    if not here.any():
        return "no particle lies in this part."
    values, name, unit = recovery.scale.stiffness(recovery.young, recovery.density)
    young, sd = values[here], recovery.log10_young_sd[here]
    span = f"a field of {name} from {young.min():.3g} to {young.max():.3g} {unit}".rstrip() + f", log10 E known to +-{sd.min():.2f} .. {sd.max():.2f}"
    return f"{span}, within {WIDEST_SD:g} in {100 * share:.0f} % of the volume."


def _part_means(values: object, part: np.ndarray) -> list[float]:
    """Geometric means over the zones of each part."""
    log = np.log(np.asarray(values, float))
    return [float(np.exp(log[part == n].mean())) if (part == n).any() else float("nan") for n in range(1, int(part.max()) + 1)]
