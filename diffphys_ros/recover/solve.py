"""The inverse solver: from start values and Gaussians to the recovered fields (paper Eq. 3 and 10)."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.ndimage import binary_dilation

from ..config import Settings
from ..devices import usable
from ..fields import Layout
from ..particles import DensePoints, dense_points
from ..types import Body, Recovery, Splats, StartValues
from .answer import Core, assemble, linear_answer, simulated_answer
from .checkpoint import Checkpoint, Stored
from .clock import Clock, OutOfTimeError
from .confidence import Confidence, Explained, of_answer
from .curvature import track_hessian
from .floor import floor_planes
from .forward import Discretisation, ForwardModel, discretise, reach_of
from .images import ImageTerm, Renderer
from .law import law_to_fit
from .minimise import Iterate, begin, lost, minimise
from .objective import Objective, Prior, Terms
from .observations import TrackTarget, acceleration_scale
from .plan import Plan, fields_wanted, make_plan
from .prepare import Prepared, scaled_start
from .progress import Progress
from .scan import SHIFTS, best_scale
from .train import Trained, train
from .zones import divided, in_parts, zones_of

MISSING = 0.1  # share of the motion missed by linear modes from which their forced frames are taken with a margin
MARGIN = 2  # frames on either side
INITIAL_MODES = 4  # modal coordinates of an unknown initial motion
POOR = 0.08  # track loss at the start above which it is taken to lie in a wrong valley; 0.5 is the frozen first frame
RIDGE = 1e-6  # curvature of the loss that is taken for certain in every direction: what nobody sees stays as it is
LONGEST_STEP, LONGEST_DAMPING = 0.4, 1.0  # of log E, and of damping in its units, in one iteration


@dataclass
class Problem:
    """Everything that one fit needs."""

    prepared: Prepared
    settings: Settings
    plan: Plan
    disc: Discretisation
    layout: Layout
    target: TrackTarget
    forward: ForwardModel
    renderer: Renderer | None
    objective: Objective
    hessian: np.ndarray


def pick_device(settings: Settings) -> str:
    """cpu or cuda:0, as asked for, or the best there is. Raises InputError where there is none such."""
    return usable(settings.fit.device)


def pose_problem(prepared: Prepared, splats: Splats | None, settings: Settings, *, dtype: torch.dtype = torch.float32) -> Problem:
    """Grid, unknowns, loss and its curvature; `dtype` of the simulation."""
    clip, body, device = prepared.clip, prepared.body, pick_device(settings)
    dense = _dense(body, splats) if settings.particles.downsample_ratio else None
    plan = make_plan(
        body,
        prepared.start.young,
        frames=len(clip) - 1,
        period_s=clip.period_s,
        settings=settings,
        device=device,
        reach_m=reach_of(prepared),
        dense=0 if dense is None else len(dense.x),
        ahead=simulated_ahead(prepared),
    )
    disc = discretise(prepared, plan, device=device, dense=dense)
    start = scaled_start(with_wider_support(prepared.start), settings.fit.start_scale / disc.apparent)
    initial_modes = 0 if settings.scene.at_rest else min(INITIAL_MODES, prepared.modal.modes)
    force_unit = acceleration_scale(prepared.tracks, clip.period_s) * float(body.density.mean())
    layout = Layout.of(start, force_unit=force_unit, initial_modes=initial_modes, motion_unit=_motion_unit(prepared))
    target = TrackTarget.of(prepared.tracks, body, clip.camera, dtype=dtype, device=device)
    planes = floor_planes(body, disc.particles, settings.scene, dx=plan.dx)
    forward = ForwardModel(prepared, disc, layout, device=device, dtype=dtype, law=law_to_fit(settings), planes=planes, simulates=plan.simulates)
    renderer = None if splats is None else Renderer.of(prepared, disc, splats, device=device)
    weights, images = settings.fit, None
    if renderer is not None and (weights.image_weight > 0 or weights.depth_weight > 0):
        with_depth = weights.depth_weight > 0 and prepared.tracks.has_depth
        images = ImageTerm(prepared, renderer, every=plan.image_every, ssim_weight=weights.ssim_weight, with_depth=with_depth)
        images.calibrate(forward.simulator.x_rest)
    precision = None if prepared.zones is None else prepared.zones.log_young_precision
    prior = Prior.of(layout, start, start_scale=weights.start_scale, precision=precision)
    per_motion = weights.track_weight + (weights.image_weight + weights.depth_weight if images else 0.0)
    curvature = per_motion * track_hessian(prepared, layout, target, initial_modes=initial_modes)
    objective = Objective(forward, target, images, prior, weights)
    return Problem(prepared, settings, plan, disc, layout, target, forward, renderer, objective, curvature + prior.hessian + RIDGE * np.eye(layout.size))


def simulated_ahead(prepared: Prepared) -> float:
    """How many times the clip, without gradient, is simulated before the search: a period to calibrate the grid, and the trials of other
    moduli where the start values may lie in a wrong valley."""
    clip, start = prepared.clip, prepared.start
    period = 1 / (max(float(start.frequencies_hz[0]), 1e-3) * (len(clip) - 1) * clip.period_s)
    return period + (len(SHIFTS) if start.track_cost > MISSING**2 else 0)


def with_wider_support(start: StartValues) -> StartValues:
    """Start values with a margin of frames that may carry a force as well, where linear modes, which the forced frames were read from, miss
    much of the motion."""
    if start.track_cost <= MISSING**2 or not start.forced.any():
        return start
    return replace(start, forced=binary_dilation(start.forced, iterations=MARGIN))


def _dense(body: Body, splats: Splats | None) -> DensePoints:
    """What particles.downsample_ratio is a share of."""
    surface = np.zeros((0, 3)) if splats is None else splats.mean.astype(float)
    return dense_points(body, body.to_body(surface))


def _motion_unit(prepared: Prepared) -> np.ndarray:
    """Units of initial modal coordinates and rates, (2, r): those that move the tracks by as much as they were seen to move."""
    tracks, modal = prepared.tracks, prepared.modal
    moved = float(np.sqrt(((tracks.points - tracks.points[:1])[tracks.valid] ** 2).sum(-1).mean()))
    shape = modal.evaluate(prepared.body.to_body(tracks.points[0]))[0]
    size = np.sqrt((shape**2).sum(1).mean(0))
    omega = 2 * np.pi * np.maximum(modal.frequencies(prepared.start.young), 0.1)
    return np.stack([moved / size, moved * omega / size])


def _repeatable(device: str) -> None:
    """Equal input gives equal bits on the CPU: the backward pass of a gather would else add from several threads in any order."""
    torch.use_deterministic_algorithms(device == "cpu")
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]  # that would only cost time


def solve(
    prepared: Prepared, splats: Splats | None, settings: Settings, *, checkpoint: Checkpoint | None = None, clock: Clock | None = None
) -> Generator[Progress, None, Recovery]:
    """Joint fit over material and force. Yields news, returns the Recovery; to stop iterating is to cancel. Where the clock stops it, the
    best answer so far is returned, and says so."""
    checkpoint, clock = checkpoint or Checkpoint(None), clock or Clock()
    checkpoint.bind(prepared.clip, settings)
    zones = yield from zones_of(prepared, settings)
    prepared = divided(prepared, zones)
    yield Progress("plan", text="choosing cells and particles")
    _repeatable(pick_device(settings))
    problem = pose_problem(prepared, splats, settings)
    count = len(problem.disc.particles.own)
    grid = f"apparent stiffness {problem.disc.apparent:.3f}, after which the grid's own error of log10 E is {problem.disc.expected_log10_error:.3f}"
    yield Progress("plan", text=f"{problem.plan.text()}; {count} particles, {grid}" if problem.plan.simulates else problem.plan.text())
    stored = checkpoint.load(problem.layout.size, problem.layout.parts)
    state = yield from _search(problem, checkpoint, clock, stored)
    trained = None
    if fields_wanted(settings) and np.isfinite(state.value) and not clock.stopped:
        trained = yield from train(problem, state, clock=clock, checkpoint=checkpoint, stored=stored)
    yield Progress("result", text="final simulation and rendering")
    recovery = in_parts(_answer(problem, state, trained, clock), zones)
    yield Progress("result", text=_verdict(recovery), artefact=recovery)
    return recovery


def _search(problem: Problem, checkpoint: Checkpoint, clock: Clock, stored: Stored | None) -> Generator[Progress, None, Iterate]:
    if not problem.plan.simulates:
        return lost(problem.layout.start)
    iterations, state = problem.plan.iterations, lost(problem.layout.start)
    problem.objective.watch = clock.check
    try:
        state = yield from _first(problem, stored)
        yield _news(problem, state, iterations, None)
        if stored is not None and stored.training is not None:
            return state  # its search had ended, maybe by the clock
        while state.iteration < iterations and not state.finished:
            before = clock.spent_s
            state = next(minimise(problem.objective, state, iterations=iterations, limit=lambda z, step: _limit(problem, z, step)))
            state = _recapture(problem, state)
            checkpoint.offer(Stored(state, problem.forward.captured))
            took = clock.spent_s - before
            yield _news(problem, state, iterations, took * (iterations - state.iteration))
            if not clock.allows_fit(took) and state.iteration < iterations and not state.finished:
                raise OutOfTimeError
    except OutOfTimeError:
        clock.stopped = f"stopped by the time budget of {clock.limit_s:.0f} s after {state.iteration} of {iterations} iterations; the best answer so far is kept"
        yield Progress("fit", text=clock.stopped)
    finally:
        problem.objective.watch = None
        checkpoint.flush()
    return state


def _first(problem: Problem, stored: Stored | None) -> Generator[Progress, None, Iterate]:
    if stored is not None:
        problem.forward.capture(stored.captured)
        return stored.state
    start, terms = problem.layout.start, problem.objective(problem.layout.start)
    if terms.motion is not None and problem.objective.track_loss(terms.motion.x) < POOR:
        return begin(lambda z: terms, start, problem.hessian)
    yield Progress("fit", text=f"the start misses the motion (loss {terms.value:.3g}): trying other moduli")
    found = best_scale(problem.objective, start, room=_room(problem, start).min())
    problem.forward.ensure_substeps(problem.layout.young_of(found))
    there = problem.objective(found)
    if not np.isfinite(there.value):
        yield Progress("fit", text=f"{problem.objective.failures[-1]}; no modulus near the start keeps it there: the start values are the answer")
        return lost(start)
    return begin(lambda z: there, found, problem.hessian)


def _recapture(problem: Problem, state: Iterate) -> Iterate:
    """Lay out the substeps anew where E has passed what they carry; value and gradient are those of the new layout."""
    if not problem.forward.ensure_substeps(problem.layout.young_of(state.z)):
        return state
    here = problem.objective(state.z)
    return replace(state, value=here.value, gradient=here.gradient())


def _limit(problem: Problem, z: np.ndarray, step: np.ndarray) -> float:
    """Share of a step that keeps log E and damping within reach: LONGEST_STEP, and what fit.max_substeps can carry."""
    parts = slice(0, problem.layout.parts)
    longest = np.array([*[LONGEST_STEP] * parts.stop, LONGEST_DAMPING, LONGEST_DAMPING])
    share = min(1.0, float((longest / np.maximum(np.abs(step[: len(longest)]), 1e-12)).min()))
    for rise, left in zip(step[parts] * share, _room(problem, z), strict=True):
        if rise > left:
            share *= max(left, 0.0) / rise
    return share


def _room(problem: Problem, z: np.ndarray) -> np.ndarray:
    """How far log E per part may still rise (n,) before fit.max_substeps no longer carry it."""
    return np.log(problem.forward.simulator.max_young(problem.settings.fit.max_substeps) / problem.layout.young_of(z))


def _news(problem: Problem, state: Iterate, iterations: int, seconds_left: float | None) -> Progress:
    young = problem.layout.young_of(state.z) * problem.disc.apparent
    text = "E " + " ".join(f"{e:.4g}" for e in young) + " Pa"
    return Progress("fit", state.iteration, iterations, state.value, seconds_left, text, artefact=young)


@dataclass(frozen=True)
class Candidate:
    """An answer, and how badly it explains the clip."""

    core: Core
    misfit: float  # in the loss's own terms, without priors
    track_rms_m: float  # of one coordinate [m]


def _candidate(problem: Problem, core: Core) -> Candidate:
    simulator = problem.forward.simulator
    x, F = simulator.x_rest + simulator.tensor(core.displacement), simulator.tensor(core.F)
    return Candidate(core, problem.objective.misfit(x, F), problem.objective.track_rms(x))


def _answer(problem: Problem, state: Iterate, trained: Trained | None, clock: Clock) -> Recovery:
    """The better explanation of the two: the simulated motion, or the linear motion of the start values."""
    terms = None if not np.isfinite(state.value) else _final_terms(problem, state) if trained is None else trained.terms
    linear = _candidate(problem, linear_answer(problem.prepared, problem.disc))
    simulated = None if terms is None or terms.motion is None else _candidate(problem, simulated_answer(problem.forward, terms))
    best = linear if simulated is None or linear.misfit < simulated.misfit else simulated
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
        "loss_history": list(state.history),
        "iterations": state.iteration,
        "not_simulated": _why_not(problem, state, clock),
        "stopped_by_budget": bool(clock.stopped),
        "cells_over_thickness": problem.plan.cells,
        "particles_per_cell_and_axis": problem.plan.per_cell,
        "substeps": problem.forward.simulator.substeps,
        "apparent_stiffness": problem.disc.apparent,
        "expected_log10_error_of_grid": problem.disc.expected_log10_error,
        "young_start_pa": problem.prepared.start.young.tolist(),
        "young_refined_pa": (problem.layout.young_of(state.z) * problem.disc.apparent).tolist(),
    }
    if trained is not None:
        metrics["fields"] = trained.summary
    found = assemble(
        problem.prepared,
        problem.disc,
        best.core,
        problem.renderer,
        confidence=_confidence(problem, best),
        substeps=problem.forward.simulator.substeps,
        metrics=metrics,
    )
    return replace(found, notes=(*found.notes, *filter(None, dict.fromkeys((metrics["not_simulated"], clock.stopped)))))


def _final_terms(problem: Problem, state: Iterate) -> Terms:
    with torch.no_grad():
        return problem.objective(state.z)


def _why_not(problem: Problem, state: Iterate, clock: Clock) -> str:
    """Why there is no simulated motion; empty where there is one."""
    if np.isfinite(state.value):
        return ""
    return problem.plan.refusal or clock.stopped or f"not simulated: {problem.objective.failures[-1]}"


def _confidence(problem: Problem, answer: Candidate) -> Confidence:
    explained = Explained(answer.track_rms_m, problem.target.mean_square**0.5, problem.hessian)
    return of_answer(problem.prepared, problem.layout, explained, simulated=answer.core.refined)


def _verdict(recovery: Recovery) -> str:
    m = recovery.metrics
    beaten = "not simulated" if m["not_simulated"] else "linear modes explain the clip better than the simulation"
    kept = "refined by simulation" if m["refined"] else f"start values kept: {beaten}"
    return f"{kept}; misfit {1e3 * m['track_rms_m']:.2f} mm, track noise {1e3 * m['track_noise_m']:.2f} mm"  # type: ignore[operator]
