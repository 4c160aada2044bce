"""How surely the net force of an answer is known, frame by frame, and its peak; world frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..config import Settings
from ..start.net_force import net_force_doubt
from ..start.second_reading import fit_at
from ..types import Recovery, StartValues, Tracks
from .answer import linear_answer
from .prepared import Prepared
from .problem import Problem


def with_doubt(
    recovery: Recovery, prepared: Prepared, settings: Settings, start: StartValues, *, seen: Tracks | None = None, missed_m: float | None = None
) -> Recovery:
    """The answer with the standard deviation of its net force and with its peak, where the force is identified.

    Args:
        recovery: the answer.
        prepared, settings: what it is of.
        start: its physics, footprint and forced frames.
        seen: of a simulated answer, tracks that move as modes would under its force; None: the tracks as they are.
        missed_m: of a simulated answer, what it misses of a frame [m].
    """
    if not recovery.force_identified:
        return recovery
    net = recovery.net_force()
    start = replace(start, forced=start.forced | net.any(1))
    if not start.forced.any():
        return replace(recovery, net_force_sd=np.zeros_like(net), net_force_peak=0.0, net_force_peak_sd=0.0)
    clip, tracks = prepared.clip, seen or prepared.tracks
    fit = fit_at(prepared.body, tracks, clip.period_s, settings, start, prepared.modal, camera=clip.camera, first_order=seen is not None)
    doubt = net_force_doubt(fit, start.log10_young_sd, missed_m=missed_m)
    turn = prepared.body.world_from_body[:3, :3]
    sd = np.zeros_like(net)
    sd[doubt.frames] = np.sqrt(np.einsum("ac,fcd,ad->fa", turn, doubt.variance, turn))
    peak, peak_sd = doubt.peak(net[doubt.frames] @ turn)
    return replace(recovery, net_force_sd=sd, net_force_peak=peak, net_force_peak_sd=peak_sd)


def linear_twin(problem: Problem, start: StartValues) -> Tracks:
    """The tracks as modes move them with the physics and the force of `start`: what a simulation moves beyond that is no doubt about the force."""
    forward, prepared = problem.forward, problem.prepared
    moved = forward.simulator.tensor(linear_answer(replace(prepared, start=start), problem.disc).displacement)
    points = prepared.tracks.points[:1] + prepared.body.rotate_to_world(problem.objective.binding.apply(moved).double().cpu().numpy())
    return replace(prepared.tracks, points=points, valid=np.ones_like(prepared.tracks.valid))


def missed_of_frame(track_rms_m: float, noise_m: float) -> float:
    """What an answer misses of a frame [m], root mean square, beyond the tracks' own noise, from what it misses of one coordinate of one track."""
    return float(np.sqrt(3 * max(track_rms_m**2 - noise_m**2, 0.0)))
