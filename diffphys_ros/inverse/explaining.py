"""Where neither modes nor a simulated force explain the motion: fields of the published schedule carry the video, and tell no stiffness."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..config import Settings
from ..devices import usable
from ..errors import InputError, SimulationError
from ..progress import Progress, waiting
from ..start.values import explained_badly
from ..types import Recovery, Splats
from .answer import notes
from .choice import unexplained
from .clock import Clock
from .evidence.pixels import static_background
from .gaussians import fit_gaussians
from .material_prior import believed, of_parts, parted
from .observed import displacement_scale
from .posterior import Confidence
from .prepared import Prepared, bounces
from .resolution import fields_wanted, longest_budget_s, time_budget_s
from .solve import solve

EXPLAINING: Mapping[str, Any] = {  # config/paper.yaml has the same values and says why [tests/inverse/test_explaining.py]
    "schedule": "paper", "force_frame": "nodes", "grid_nodes": 64, "per_cell": 1.6, "sheet_share": 0.02, "soft_sd": 2.0, "force_voxels": 40,
    "transition_iterations": 60, "coarse_px": 8, "frame_drag": 2.0, "track_weight": 0.0, "depth_weight": 0.0, "image_every": 1,
    "force_smoothness": 3e-5, "mask_margin_px": 3, "splat_spread_px": 4.0, "splat_edge_px": 1,
}  # fmt: skip
UNKNOWN = "unknown"  # material of the database, for want of a better one
FIRST_SHARE = 0.5  # of the time for search and training, after which constants end where modes miss the motion: fields need the rest [chosen]
LEAST_SHARE = 0.1  # of all the time that must be left for fields: body and Gaussians are made anew first [chosen]
CARRIED = "forces that act everywhere, frame by frame, carry the video where one force does not: they explain it, on an assumed stiffness, and measure nothing."
IN_VAIN = "fields, which would carry the video, were stopped before they showed it better: raise fit.time_budget_s beyond {:.0f} s."

Carried = tuple[Prepared, Splats, Recovery, np.ndarray]  # the last: the scene behind the object, uint8 (H, W, 3)


def calls_for_fields(prepared: Prepared, recovery: Recovery) -> bool:
    """Whether an answer leaves unexplained what pictures show."""
    return recovery.frames is not None and unexplained(prepared, recovery)


def may_carry(prepared: Prepared, settings: Settings) -> bool:
    """Whether fields may carry the video: where nobody asked for another fit, and the body is that of frame 0. What bounces is moved by a floor that is
    told: a simulation with it has the motion, fields without it have pictures alone."""
    asked = settings.experiment.schedule != "auto" or settings.fit.iterations or settings.fit.hold is not None or fields_wanted(settings)
    return not asked and prepared.hanging is None and prepared.tracks.first is None and not bounces(prepared.body, settings.scene)


def modes_miss(prepared: Prepared) -> bool:
    """Whether the start values tell no stiffness and miss much of the motion."""
    start, size = prepared.start, displacement_scale(prepared.tracks)
    return not start.identified.any() and explained_badly(start.track_cost**0.5 * size, prepared.tracks.noise_m, size)


def carried_by_fields(prepared: Prepared, splats: Splats, recovery: Recovery, behind: np.ndarray, settings: Settings, clock: Clock) -> Generator[Progress, None, Carried]:
    """What fields make of a clip that an answer leaves unexplained, where that shows it better; else what was given. Yields news."""
    kept = prepared, splats, recovery, behind
    if not clock.allows_fit(LEAST_SHARE * clock.limit_s):
        said = f"too little time is left for fields, which would carry the video: raise fit.time_budget_s beyond {clock.limit_s:.0f} s"
        yield Progress("fields", text=said)
        return *kept[:2], replace(recovery, notes=(*recovery.notes, said)), behind
    yield Progress("fields", text="the motion is not explained: forces that act everywhere, frame by frame, carry the video")
    try:
        found = yield from _by_fields(prepared, explaining(settings), clock)
    except (InputError, SimulationError) as error:
        yield Progress("fields", text=f"not carried by fields: {error}")
        return kept
    before, after = (float(each.metrics["psnr_masked"]) for each in (recovery, found[2]))  # type: ignore[arg-type]
    yield Progress("fields", text=f"PSNR {after:.1f} dB by fields, {before:.1f} without")
    if after > before:
        return *found[:2], _told(found[0], found[2], recovery), found[3]
    if found[2].metrics["stopped_by_budget"]:
        return prepared, splats, replace(recovery, notes=(*recovery.notes, IN_VAIN.format(clock.limit_s))), behind
    return kept


def explaining(settings: Settings) -> Settings:
    """Settings of the published schedule, for the rest as they are."""
    fit = replace(settings.fit, hold=["density", "damping"], material_field="residual", force_field="voxels")
    prior = settings.prior if settings.prior.source != "none" else replace(settings.prior, materials=[UNKNOWN])
    return replace(settings, fit=fit, prior=prior, experiment=replace(settings.experiment, **EXPLAINING))


def lengthened(settings: Settings, clock: Clock) -> tuple[Settings, Clock]:
    """Settings and clock of a clip whose fields may have to carry the video: where nobody told its time, it has more."""
    if clock.longest_s <= clock.limit_s:
        return settings, clock
    return _planned_for(settings, longest_budget_s(settings, usable(settings.fit.device))), clock.longest()


def shortened(settings: Settings, clock: Clock) -> tuple[Settings, Clock]:
    """Settings and clock of a search that leaves time for fields; planned as for a clip that is alone."""
    if not np.isfinite(clock.limit_s):
        return settings, clock
    return _planned_for(settings, FIRST_SHARE * time_budget_s(settings, usable(settings.fit.device))), clock.within(FIRST_SHARE)


def _planned_for(settings: Settings, seconds: float) -> Settings:
    return replace(settings, fit=replace(settings.fit, time_budget_s=seconds))


def _by_fields(prepared: Prepared, asked: Settings, clock: Clock) -> Generator[Progress, None, Carried]:
    clip = prepared.clip
    again = yield from _as_sheet(prepared, asked)
    behind = static_background(clip, edge_px=asked.experiment.splat_edge_px)
    splats = yield from fit_gaussians(clip, prepared.depth0, asked, behind=behind)
    recovery = yield from solve(again, splats, asked, behind=behind, clock=clock)
    return again, splats, recovery, behind


def _as_sheet(prepared: Prepared, asked: Settings) -> Generator[Progress, None, Prepared]:
    """With a thin body where nobody told its thickness, and what is believed of its material."""
    from ..body import build_body
    from ..prior import believing
    from ..start import start_values

    clip, tracks = prepared.clip, prepared.tracks
    prior = yield from waiting("body", believing(clip, asked))
    assert prior is not None
    body = parted(build_body(clip, prepared.depth0, asked), prior, clip.camera)
    body, belief = believed(body, prior, clip.camera, asked.scene), of_parts(prior, body, clip.camera)
    body = replace(body, sources=prepared.body.sources | body.sources)
    start, modal = start_values(body, tracks, clip.period_s, asked, camera=clip.camera, belief=belief)
    return replace(prepared, body=body, start=start, modal=modal, prior=prior, zones=None)


def _told(prepared: Prepared, recovery: Recovery, before: Recovery) -> Recovery:
    """The answer by fields, with the reasons why nothing was identified before."""
    n = len(recovery.identified)
    reasons = before.reasons if len(before.reasons) == n else (before.reasons[0],) * n
    confidence = Confidence(recovery.log10_young_sd, recovery.identified, reasons, recovery.young_lower, False, CARRIED)
    said = [note for note in recovery.notes if note not in notes(prepared, replace(confidence, reasons=recovery.reasons, force_reason=recovery.force_reason))]
    metrics = recovery.metrics | {"force_reason": CARRIED, "carried_by_fields": True, "psnr_masked_without_fields": before.metrics["psnr_masked"]}
    return replace(recovery, reasons=reasons, force_reason=CARRIED, notes=(*notes(prepared, confidence), *said), metrics=metrics)
