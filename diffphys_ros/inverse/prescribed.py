"""Unknowns that an earlier result, or another simulator, tells: what is held takes its values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import shapes, store
from ..config import Settings
from ..damping import Damping
from ..errors import InputError
from ..start.values import GUESS_SD
from ..types import Body, Grid, MaterialDoubt, StartValues
from .prepared import Prepared
from .problem import Problem
from .unknowns import checked_hold

FILE = "recovery.npz"
TOLD_SD = 0.01  # of log10 E that is told
TOLD = {
    "points": "real N 3", "part": "whole N", "volume": "positive N", "young": "gap N", "force": "real T N 3", "clamped": "truth N",
    "young_solver": "?positive N", "apparent_stiffness": "?positive", "engine": "?text", **shapes.DAMPING,
}  # fmt: skip
ON_NODES = {  # of a force on the nodes of a grid, beside TOLD
    "mpm_node": "whole M", "mpm_node_force": "real t M 3", "grid_origin": "real 3", "grid_dx": "positive", "grid_size": "whole 3", "grid_clamp_index": "whole",
    "world_from_body": "real 4 4",
}  # fmt: skip
SAME_POSE = 1e-3  # of a cell, and of a radian, by which grids and bodies that are the same may differ [numerical]
NET_ALONE = "fit.prescribe: the force there varies over the body, of which the net force of each frame alone is taken, as that of a {} force."
NOT_IDENTIFIED = "told by fit.prescribe, where it is not identified: it is the modulus that the simulation there moved with."


def told_by(settings: Settings) -> dict[str, np.ndarray] | None:
    """The result that fit.prescribe names; None where it names none. Raises InputError for a file that holds no result."""
    if settings.fit.prescribe is None:
        return None
    found = store.read_arrays(_file(settings.fit.prescribe), "fit.prescribe", cure="give the folder of a result")
    try:
        sizes = shapes.check(found, TOLD)
        if "mpm_node_force" in found:
            shapes.check(found, ON_NODES, {"t": sizes["T"] - 1})
    except shapes.MisshapenError as error:
        raise InputError(f"fit.prescribe {_file(settings.fit.prescribe)}: {error}; give the folder of a result") from error
    return found


def prescribed(prepared: Prepared, settings: Settings, told: dict[str, np.ndarray] | None) -> Prepared:
    """The clip with what a result (`told_by`) tells of the blocks that fit.hold names; unchanged where nothing is prescribed.

    E [Pa] of a part is the mean of its logarithm over the volume, where it is not identified that of the modulus that the result moved with; the force [N/m^3] of a frame is the amplitude of the start values' family
    with the told net force, or where forces act on nodes there and here, the told ones (`push_as_told`) under the damping that they had. Densities and Poisson's ratios are told by scene.density_kg_m3 and scene.poisson_ratio. Raises InputError for a
    file that does not fit the clip.
    """
    if told is None:
        return prepared
    held, notes = checked_hold(settings.fit.hold), []
    body, start = prepared.body, prepared.start
    if "young" in held:
        young = 10 ** _per_part(told, np.log10(_moved_with(told)), body.parts, "young")
        known = np.array([np.isfinite(told["young"][told["part"] == number]).any() for number in range(1, body.parts + 1)])
        reasons = tuple("told by fit.prescribe." if sure else NOT_IDENTIFIED for sure in known)
        sd, exact = np.where(known, TOLD_SD, GUESS_SD), MaterialDoubt.none(body.parts)  # whatever the densities are
        start = replace(start, young=young, log10_young_sd=sd, material=exact, identified=known, reasons=reasons, young_lower=np.full(body.parts, np.nan))
        notes += [f"Young's modulus of part {number}: {NOT_IDENTIFIED}" for number in np.flatnonzero(~known) + 1]
    on_nodes = "force" in held and "mpm_node_force" in told and settings.experiment.force_frame == "nodes"
    if "damping" in held or on_nodes:
        start = replace(start, damping=Damping.of_stored(told))
    if "force" in held:
        _require_frames(told, settings, len(prepared.clip))
        force = np.zeros_like(start.force) if on_nodes else _amplitudes(told, body, start)
        if not on_nodes and ("mpm_node_force" in told or "mpm_field_force" in told):
            notes.append(NET_ALONE.format(start.footprint.family))
        start = replace(start, force=force, forced=np.abs(force).max(1) > 0)
    clip = replace(prepared.clip, notes=(*prepared.clip.notes, *notes))
    return replace(prepared, clip=clip, start=start)


def push_as_told(problem: Problem, settings: Settings, told: dict[str, np.ndarray] | None) -> None:
    """Where forces act on nodes and fit.hold names them, those of a result (`told_by`) that has such act again. Raises InputError where they are nodes of another grid."""
    forward, grid = problem.forward, problem.disc.grid
    if told is None or "mpm_node_force" not in told or "force" not in problem.layout.held or forward.nodes is None:
        return
    there = Grid(told["grid_origin"], float(told["grid_dx"]), tuple(told["grid_size"].tolist()), int(told["grid_clamp_index"]))
    near = np.abs(there.origin - grid.origin).max() < SAME_POSE * grid.dx and np.abs(told["world_from_body"] - problem.prepared.body.world_from_body).max() < SAME_POSE
    number = forward.nodes.number.cpu().numpy()
    if not (near and there.size == grid.size and there.clamp_index == grid.clamp_index and np.array_equal(told["mpm_node"], number)):
        each = "; here ".join(f"{count} of {' x '.join(map(str, g.size))}, {1e3 * g.dx:.2f} mm apart" for count, g in ((len(told["mpm_node"]), there), (len(number), grid)))
        raise InputError(
            f"fit.prescribe {_file(settings.fit.prescribe)}: its force acts on nodes of another grid or body ({each}); give a result of the same clip, scene, experiment.grid_nodes and particles"
        )
    forward.told_force = forward.simulator.tensor(told["mpm_node_force"])


def _file(path: str | None) -> Path:
    assert path is not None
    return Path(path) / FILE if Path(path).is_dir() else Path(path)


def _require_frames(told: dict[str, np.ndarray], settings: Settings, frames: int) -> None:
    """A force is told frame by frame. Raises InputError."""
    if (there := len(told["force"])) != frames:
        raise InputError(f"fit.prescribe {_file(settings.fit.prescribe)}: has {there} frames, the clip has {frames}; give a result of this clip")


def _moved_with(told: dict[str, np.ndarray]) -> np.ndarray:
    """E [Pa] (N,), where it is not identified what the simulation moved with, less what its grid made of that; NaN where nobody says it."""
    if "young_solver" not in told:
        return told["young"]
    on_grid = told.get("apparent_stiffness", 1.0) if str(told.get("engine", "mpm")) == "mpm" else 1.0
    return np.where(np.isfinite(told["young"]), told["young"], told["young_solver"] * on_grid)


def _per_part(told: dict[str, np.ndarray], values: np.ndarray, parts: int, name: str) -> np.ndarray:
    """Means over the volume of each part, (n,)."""
    known, part = np.isfinite(values), told["part"]
    lacking = [number for number in range(1, parts + 1) if not (known & (part == number)).any()]
    if lacking:
        raise InputError(f"fit.prescribe: tells no {name} of part {lacking[0]} of {parts}; take {name} out of fit.hold, or give a result that has it")
    return np.array([np.average(values[known & (part == number)], weights=told["volume"][known & (part == number)]) for number in range(1, parts + 1)])


def _amplitudes(told: dict[str, np.ndarray], body: Body, start: StartValues) -> np.ndarray:
    """Amplitudes (T, 3) of the start values' family, body frame, that have the told net force on the free particles."""
    free = ~told["clamped"].astype(bool)
    volume = told["volume"][free]
    net = np.einsum("tnc,n->tc", told["force"][:, free].astype(float), volume)
    carried = start.footprint.weights(body.to_body(told["points"][free])) @ volume
    return net @ body.world_from_body[:3, :3] / carried
