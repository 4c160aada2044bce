"""The better explanation of the clip: the simulated motion, or the linear one of the start values."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch

from ..start.values import explained_badly
from ..types import Recovery, StartValues
from .answer import Core, assemble, linear_answer, simulated_answer
from .clock import Clock
from .evidence import Moved
from .fit import Fitted
from .frame_metrics import where_it_moves
from .loss import Terms
from .net_force import linear_twin, missed_of_frame, with_doubt
from .observed import displacement_scale
from .posterior import Confidence, Explained, of_answer
from .prepared import Prepared
from .problem import Problem
from .published import unidentified
from .second_reading import as_start

STANDS = "stands still: no motion that was found shows the clip better"
STILL = "no motion that was found shows the clip better than its first frame: the answer stands still."


@dataclass(frozen=True)
class Candidate:
    """An answer, and how badly it explains the clip."""

    core: Core
    misfit: float  # in the loss's own terms, without priors
    track_rms_m: float  # of one coordinate [m]
    start: StartValues  # its physics as those of start values


def _candidate(problem: Problem, core: Core, start: StartValues) -> Candidate:
    forward, tensor = problem.forward, problem.forward.simulator.tensor
    moved = Moved(forward.simulator.x_rest + tensor(core.displacement), tensor(core.F), forward.density_of(tensor(core.force), core.field_force))
    return Candidate(core, problem.objective.misfit(moved), problem.objective.track_rms(moved.x), start)


def answered(fitted: Fitted, clock: Clock) -> Recovery:
    """The better explanation of the two: the simulated motion, or the linear motion of the start values."""
    problem, terms = fitted.model.problem, None
    if np.isfinite(fitted.value):
        with torch.no_grad():
            terms = fitted.model()
    linear = _linear(fitted)
    simulated = None if terms is None or terms.motion is None or not fitted.simulated else _candidate(problem, simulated_answer(problem.forward, terms), as_start(fitted))
    published = problem.settings.experiment.published  # whose motion is always that of the material points
    best = linear if simulated is None or (linear.misfit < simulated.misfit and not published) else simulated
    metrics = {
        "refined": best is simulated,
        "misfit": best.misfit,
        "misfit_refined": np.inf if simulated is None else simulated.misfit,
        "misfit_start": linear.misfit,
        "track_rms_m": best.track_rms_m,
        "track_rms_refined_m": np.inf if simulated is None else simulated.track_rms_m,
        "track_rms_start_m": linear.track_rms_m,
        "track_noise_m": problem.prepared.tracks.noise_m,
        "loss": {} if terms is None else terms.parts,
        "loss_history": fitted.losses.get("fit", []),
        "iterations": max(len(fitted.losses.get("fit", [])) - 1, 0),
        "not_simulated": _why_not(fitted, clock),
        "stopped_by_budget": bool(clock.stopped),
        "cells_over_thickness": problem.plan.cells,
        "particles_per_cell_and_axis": problem.plan.per_cell,
        "substeps": problem.forward.simulator.substeps,
        "apparent_stiffness": problem.disc.apparent,
        "expected_log10_error_of_grid": problem.disc.expected_log10_error,
        "young_start_pa": problem.prepared.start.young.tolist(),
        "young_refined_pa": (problem.layout.young_of(fitted.z) * problem.disc.apparent).tolist(),
    }
    if (hanging := problem.prepared.hanging) is not None:
        metrics["outline"] = asdict(hanging)
    if terms is not None and fitted.model.material is not None:
        metrics["fields"] = _of_fields(fitted, terms)
    confidence = _confidence(problem, best)
    found = _assembled(problem, best, confidence, metrics)
    said = dict.fromkeys((metrics["not_simulated"], clock.stopped))
    if worse_than_still(found, problem.prepared):
        still = _still(problem)
        stands = _assembled(problem, still, confidence, of_still(metrics, still))
        if _psnr(stands, problem.prepared)[0] > _psnr(found, problem.prepared)[0]:
            found, said = stands, {**said, STILL: None}
    return replace(found, notes=(*found.notes, *filter(None, said)))


def _assembled(problem: Problem, best: Candidate, confidence: Confidence, metrics: dict[str, Any]) -> Recovery:
    made = assemble(problem.prepared, problem.disc, best.core, problem.renderer, confidence=confidence, substeps=problem.forward.simulator.substeps, metrics=metrics)
    if not best.core.refined or not made.force_identified:
        return with_doubt(made, problem.prepared, problem.settings, best.start)
    missed_m = missed_of_frame(best.track_rms_m, problem.prepared.tracks.noise_m)
    return with_doubt(made, problem.prepared, problem.settings, best.start, seen=linear_twin(problem, best.start), missed_m=missed_m)


def unexplained(prepared: Prepared, recovery: Recovery) -> bool:
    """Whether an answer tells no stiffness and misses much of the motion."""
    missed = np.sqrt(3) * float(recovery.metrics["track_rms_m"])  # type: ignore[arg-type]
    return not recovery.identified.any() and explained_badly(missed, prepared.tracks.noise_m, displacement_scale(prepared.tracks))


def worse_than_still(recovery: Recovery, prepared: Prepared) -> bool:
    """Whether an answer that explains little shows the video worse than its first frame does, where the object moves: before that, the first frame
    is what the video shows, and no rendering comes as near."""
    if recovery.frames is None or not unexplained(prepared, recovery):
        return False
    own, frozen = _psnr(recovery, prepared)
    return own < frozen


def _psnr(recovery: Recovery, prepared: Prepared) -> tuple[float, float]:
    """Of the answer's pictures and of the first frame [dB], where the object moves; NaN where it never does."""
    assert recovery.frames is not None
    found = where_it_moves(recovery.frames, prepared)
    return found["psnr_masked_moving"], found["psnr_masked_moving_frozen_frame"]


def _still(problem: Problem) -> Candidate:
    """The body as it is in frame 0, without a force."""
    start = problem.prepared.start
    none = np.zeros_like(start.initial_displacement)
    silent = replace(start, force=np.zeros_like(start.force), initial_displacement=none, initial_velocity=none)
    return _candidate(problem, linear_answer(replace(problem.prepared, start=silent), problem.disc), silent)


def of_still(metrics: dict[str, Any], still: Candidate) -> dict[str, Any]:
    """The metrics of the answer that stands still, from those of the one that it takes the place of: it has no fields."""
    kept = {name: value for name, value in metrics.items() if name != "fields"}
    return kept | {"refined": False, "misfit": still.misfit, "track_rms_m": still.track_rms_m}


def _linear(fitted: Fitted) -> Candidate:
    """The linear motion of the start values, or of what the linear engine has made of them where that is nearer."""
    problem = fitted.model.problem
    begun = _candidate(problem, linear_answer(problem.prepared, problem.disc), problem.prepared.start)
    if fitted.simulated or not np.isfinite(fitted.value):
        return begun
    start = as_start(fitted)
    found = _candidate(problem, linear_answer(replace(problem.prepared, start=start), problem.disc), start)
    return found if found.misfit < begun.misfit else begun


def _why_not(fitted: Fitted, clock: Clock) -> str:
    """Why there is no simulated motion; empty where there is one."""
    if fitted.simulated:
        return ""
    problem = fitted.model.problem
    return problem.plan.refusal or clock.stopped or f"not simulated: {problem.objective.failures[-1]}"


def _confidence(problem: Problem, answer: Candidate) -> Confidence:
    moved = np.log10(answer.start.young / problem.prepared.start.young)
    explained = Explained(answer.track_rms_m, problem.target.mean_square**0.5, problem.disc.expected_log10_error, moved, problem.hessian)
    found = of_answer(problem.prepared, problem.layout, explained, simulated=answer.core.refined)
    return unidentified(found) if problem.settings.experiment.published else found


def verdict(recovery: Recovery) -> str:
    m = recovery.metrics
    beaten = "not simulated" if m["not_simulated"] else "linear modes explain the clip better than the simulation"
    kept = STANDS if STILL in recovery.notes else "refined by simulation" if m["refined"] else f"start values kept: {beaten}"
    return f"{kept}; misfit {1e3 * m['track_rms_m']:.2f} mm, track noise {1e3 * m['track_noise_m']:.2f} mm"  # type: ignore[operator]


def _of_fields(fitted: Fitted, terms: Terms) -> dict[str, Any]:
    """How far the fields went from what constants and vectors ended with."""
    model, problem = fitted.model, fitted.model.problem
    assert model.material is not None
    p, own, zones = problem.disc.particles, problem.disc.particles.own, problem.prepared.zones
    part = (p.part if zones is None else zones.part[p.part - 1])[own]
    with torch.no_grad():
        ratio = (model.material(model.x).young / model.start.young).log10().double().cpu().numpy()
    acted = None if terms.motion is None else terms.motion.field_force
    force = np.full((1, len(own)), np.nan) if acted is None else acted[:, own].norm(dim=-1).double().cpu().numpy()
    return {
        "material_field": problem.settings.fit.material_field,
        "force_field": problem.settings.fit.force_field,
        "force_frame": problem.settings.experiment.force_frame,
        "loss_history": fitted.losses.get("fields", []),
        "log10_young_change_per_part": [float(ratio[own][part == k].mean()) for k in np.unique(part)],
        "log10_young_change_spread": float(ratio[own].std()),
        "field_force_rms_n_m3": float(np.sqrt((force**2).mean())),
    }
