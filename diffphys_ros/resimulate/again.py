"""The stored initial value problem of a result, solved once more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from .. import result
from ..errors import InputError, short
from ..types import ModalProblem, MpmProblem, Recovery
from .eigenmodes import eigenmodes
from .material_points import material_points

DEVICES = ("cpu", "cuda:0")
Report = Callable[[float], None]


def simulate_again(
    recovery: Recovery | str | Path,
    *,
    young_scale: float = 1.0,
    force_scale: float = 1.0,
    free_frames: int = 0,
    device: str = "cpu",
    report: Report | None = None,
) -> np.ndarray:
    """Positions of the body's own particles [m], world frame, float32, shape (T, N, 3), as `Recovery.trajectory`.

    `recovery` is one or the folder of one. On the kind of device that it was recovered on, the result is its trajectory to the
    bit, else to rounding. `young_scale` and `force_scale` multiply every Young's modulus and every force. The state of frame 0
    stays as it was recovered, its strain included: under gravity a softer body sags on from there. `free_frames` more frames follow the
    recovered ones, from the last of which on no force acts. `device`: cpu or cuda:0; `report` hears the share of frames done.
    Raises InputError, and SimulationError where the motion leaves the grid.
    """
    if not (np.isfinite(young_scale) and young_scale > 0):
        raise InputError(f"young_scale is {young_scale:g}, must be > 0; 1 simulates what was recovered")
    if not np.isfinite(force_scale):
        raise InputError(f"force_scale is {force_scale:g}, must be finite; 1 simulates what was recovered")
    if free_frames < 0:
        raise InputError(f"free_frames is {free_frames}, must be at least 0; 0 ends with the recovered frames")
    _check(device)
    if not isinstance(recovery, Recovery):
        recovery = result.load(recovery)
    problem = let_free(recovery.simulation, free_frames)
    if isinstance(problem, MpmProblem):
        displacement, own = material_points(recovery, problem, young_scale, force_scale, device=device, report=report), ~problem.ghost
        rest, moved = problem.rest[own], problem.rest[own] + displacement[:, own]
    else:
        rest, moved = problem.rest, problem.rest + eigenmodes(recovery, problem, young_scale, force_scale)
    placed = recovery.points - recovery.to_world(rest)  # 0 where the body was built in the pose of frame 0
    return (recovery.to_world(moved) + placed).astype(np.float32)


def let_free(problem: MpmProblem | ModalProblem, frames: int) -> MpmProblem | ModalProblem:
    """The same problem lasting so many frames longer: what acts from its last frame on was never seen, and is no force."""
    if not frames:
        return problem
    force = np.concatenate([problem.force[:-1], np.zeros((frames + 1, *problem.force.shape[1:]), problem.force.dtype)])
    if not isinstance(problem, MpmProblem):
        return replace(problem, force=force)
    return replace(problem, force=force, field_force=_longer(problem.field_force, frames), node_force=_longer(problem.node_force, frames))


def _longer(field: np.ndarray | None, frames: int) -> np.ndarray | None:
    """A force that lasts so many frames longer, as zero."""
    return None if field is None else np.concatenate([field, np.zeros((frames, *field.shape[1:]), field.dtype)])


def _check(device: str) -> None:
    if device not in DEVICES:
        raise InputError(f"device is {short(device)}, must be one of {', '.join(DEVICES)}; leave it at {DEVICES[0]}")
    if device != "cpu" and not torch.cuda.is_available():
        raise InputError(f"device is {short(device)}: there is no CUDA device; choose cpu")
