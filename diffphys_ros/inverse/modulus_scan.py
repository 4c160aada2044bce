"""All moduli times one number: the scan that finds the right valley when the start lies in another one."""

from __future__ import annotations

import numpy as np
import torch

from ..errors import SimulationError
from .forward import ForwardModel
from .problem import SHIFTS, Problem

STATE_BYTES, MOST_BYTES = 96, 512e6  # of a particle in a frame; of the states of one batch


def best_scale(problem: Problem, z: np.ndarray, *, room: float) -> np.ndarray:
    """z with all moduli times the factor under which the tracks are explained best.

    A start whose phase runs off by half a swing lies in another valley than the answer, where no gradient leads out; a scan over
    one number does. log E may rise by `room` at most. The trials run as batches of independent simulations.
    """
    trials = np.repeat(z[None], len(SHIFTS), 0)
    trials[:, : problem.layout.parts] += np.minimum(SHIFTS, room)[:, None]
    values = np.concatenate([track_values(problem, batch) for batch in _batches(problem.forward, trials)])
    return trials[int(np.argmin(values))]


def track_values(problem: Problem, trials: np.ndarray) -> np.ndarray:
    """Track loss and prior (B,) of unknowns (B, size) that differ in log E alone; infinite where a simulation left its bounds."""
    try:
        displacements = problem.forward.displacements(trials, report=problem.objective.watch)
    except SimulationError:
        if len(trials) == 1:
            return np.array([np.inf])
        return np.concatenate([track_values(problem, trial[None]) for trial in trials])
    objective = problem.objective
    priors = [float(objective.prior.value(torch.as_tensor(trial))) for trial in trials]
    tracks = [float(objective.target.loss(objective.binding.apply(moved))) for moved in displacements]
    return problem.settings.experiment.track_weight * np.array(tracks) + priors


def _batches(forward: ForwardModel, trials: np.ndarray) -> list[np.ndarray]:
    states = len(forward.prepared.clip) * len(forward.disc.particles.x_rest) * STATE_BYTES
    return np.array_split(trials, int(np.ceil(len(trials) * states / MOST_BYTES)))
