"""What stored arrays must look like: shape, kind of number and bounds, by the fields of types.

A line is a kind and the lengths of the axes: "real T N 3". A letter stands for one length wherever it occurs; "?" before the kind means
that the array may be absent. Kinds: real (finite floating point), gap (floating point that may be unknown), positive and amount (real > 0 and >= 0),
number (real or whole, finite), whole, truth, pixel (uint8), text.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .footprints import FAMILIES
from .types import Body, Camera, Clip, Grid, MaterialPrior, ModalProblem, MpmProblem, Recovery, StartValues, Tracks

LARGEST = 1e30  # magnitude of any quantity in SI units; its square is still a number
MOST_NODES = 100_000_000  # of a grid
Sizes = dict[str, int]

CAMERA = {"pixel_from_camera": "real 3 3", "world_from_camera": "real 4 4"}
CLIP = {"frames": "pixel T H W 3", "period_s": "positive", "depth": "?real T H W", "labels": "?pixel T H W", "observed": "?truth T", "first_labels": "?pixel H W", "gravity": "?real 3"}
TRACKS = {"pixels": "gap T M 2", "points": "gap T M 3", "valid": "truth T M", "noise_m": "amount", "sd_m": "?gap T M 2", "first": "?real M 3", "normals": "?real M 3"}
BODY = {
    "world_from_body": "real 4 4", "inside": "truth X Y", "origin": "real 2", "pitch_m": "positive", "half_thickness": "amount X Y", "part": "whole X Y",
    "density": "positive n", "poisson": "real n", "gravity": "real 3", "clamp_sd_m": "?amount",
}  # fmt: skip
DAMPING = {"mass_damping": "real", "stiffness_damping": "real"}
START = {
    "young": "positive n", "log10_young_sd": "gap n", "forced": "truth T",
    "force": "real T 3", "initial_displacement": "real i", "initial_velocity": "real i", "frequencies_hz": "gap v", "observed_hz": "gap o", "decay_per_s": "gap d",
    "track_cost": "gap", "identified": "truth n", "geometry_sd": "gap n", "young_lower": "gap n", "density": "positive n", "poisson": "real n", "detuning": "?amount",
}  # fmt: skip
MODAL = {
    "nodes": "real V 3", "tets": "whole E 10", "part": "whole E", "basis": "real V 3 r", "stiffness": "real n r r", "by_poisson": "real n r r", "poisson": "real n", "inertia": "real m r r", "prestress": "real m r r",
    "weight": "real m r", "density": "positive m", "retuning": "real r r", "reference": "positive n",
}  # fmt: skip
PRIOR = {"index": "whole H W", "young": "positive K", "log10_young_sd": "amount K", "poisson": "real K", "density": "positive K"}
ZONED = {"part": "whole n", "log_young_precision": "real n n"}
RECOVERY = {
    "points": "real N 3", "volume": "positive N", "part": "whole N", "young": "gap N", "log10_young_sd": "gap N", "poisson": "real N", "density": "positive N",
    "poisson_sd": "amount N", "density_sd": "amount N", "young_lower": "gap N", "log10_specific_sd": "gap N",
    "force": "real T N 3", "net_force_sd": "gap T 3", "net_force_peak": "gap", "net_force_peak_sd": "gap", "trajectory": "real T N 3", "clamped": "truth N", "frames": "?pixel T H W 3", "world_from_body": "real 4 4", "gravity": "real 3",
    "apparent_stiffness": "positive", "period_s": "positive", "substeps": "whole",
    "initial_velocity": "real N 3", "identified": "truth n",
}  # fmt: skip
MPM = {
    "ghost": "truth P", "rest": "real P 3", "volume": "positive P", "density": "positive P", "young": "positive P", "poisson": "real P", "position": "real P 3",
    "velocity": "real P 3", "velocity_gradient": "real P 3 3", "deformation_gradient": "real P 3 3", "force": "real T 3", "force_weight": "real P",
    "damping_shapes": "real P 3 m", "damping_gradients": "real P 3 3 m", "damping_frequencies": "real m", "damping_own": "?real m", "retuning": "?real m m", "law": "text", "plane_normal": "real K 3",
    "plane_offset": "real K", "plane_friction": "real K", "plane_kind": "text K", "field_force": "?real t P 3", "node": "?whole M", "node_force": "?real t M 3",
}  # fmt: skip
MODES = {
    "rest": "real N 3", "young": "positive N", "basis": "real N 3 r", "elastic": "real r r", "geometric": "real r r", "retuning": "real r r", "load": "real r 3",
    "force": "real T 3", "initial_displacement": "real r", "initial_velocity": "real r",
}  # fmt: skip


class MisshapenError(ValueError):
    """Which array is not what it must be, and how."""


def check(values: Mapping[str, Any], table: Mapping[str, str], sizes: Sizes | None = None) -> Sizes:
    """Holds every array of the table to its line; returns the lengths that letters stand for, `sizes` among them. Raises MisshapenError."""
    sizes = {} if sizes is None else dict(sizes)
    for name, line in table.items():
        kind, *axes = line.split()
        value = values.get(name)
        if value is None and kind.startswith("?"):
            continue
        if value is None:
            raise MisshapenError(f"{name} is missing")
        _check_one(name, np.asarray(value), kind.removeprefix("?"), axes, sizes)
    return sizes


def require(sound: bool | np.bool_, words: str) -> None:
    """Raises MisshapenError with these words unless `sound`."""
    if not sound:
        raise MisshapenError(words)


def check_camera(camera: Camera, sizes: Sizes) -> None:
    """A pinhole that sees images of H x W pixels. Raises MisshapenError."""
    check(vars(camera), CAMERA)
    k = camera.pixel_from_camera
    require(k[0, 0] > 0 and k[1, 1] > 0 and (k[2] == (0, 0, 1)).all(), "the camera's matrix is that of no pinhole")
    require((camera.height, camera.width) == (sizes["H"], sizes["W"]), f"images are not of the camera's {camera.width} x {camera.height} pixels")


def check_clip(clip: Clip) -> Sizes:
    """Raises MisshapenError."""
    sizes = check(vars(clip), CLIP)
    require(min(sizes[letter] for letter in "THW") > 0, "frames is empty")
    require(abs(clip.start_ns) + 1e9 * clip.period_s * sizes["T"] < 2.0**63, "stamps lie beyond 64 bits of nanoseconds")
    check_camera(clip.camera, sizes)
    if clip.thickness is not None:
        check(vars(clip.thickness), {"extent_m": "positive", "axis": "real 3"})
    return sizes


def check_tracks(tracks: Tracks, frames: int) -> None:
    """Raises MisshapenError."""
    check(vars(tracks), TRACKS, {"T": frames})
    require(tracks.valid[0].all(), "tracks do not hold in frame 0")
    require(np.isfinite(tracks.points[tracks.valid]).all() and np.isfinite(tracks.pixels[tracks.valid]).all(), "tracks that hold are not finite")


def check_body(body: Body) -> int:
    """Number of parts. Raises MisshapenError."""
    sizes = check(vars(body), BODY)
    require(min(sizes[letter] for letter in "XYn") > 0 and body.inside.any(), "the body is empty")
    require(body.part.min() >= 1 and body.part.max() <= sizes["n"], f"numbers of parts lie beyond 1 .. {sizes['n']}")
    require((np.abs(body.poisson) < 0.5).all(), "Poisson's ratio lies beyond 0.5")
    return sizes["n"]


def check_start(start: StartValues, frames: int, parts: int) -> None:
    """Raises MisshapenError."""
    check(vars(start), START, {"T": frames, "n": parts})
    check(start.damping.stored(), DAMPING)
    check(vars(start.material), dict.fromkeys(vars(start.material), "amount n"), {"n": parts})
    check(vars(start.footprint), {"parameters": f"real {3 if start.footprint.family == 'gaussian' else 0}"})
    require(start.footprint.family in FAMILIES, "the force has no known footprint")
    require(len(start.reasons) == parts, "there is not one reason per part")


def check_modal(modal: Any, parts: int) -> None:
    """A modes.ModalModel. Raises MisshapenError."""
    sizes = check(vars(modal), MODAL, {"n": parts})
    require(min(sizes[letter] for letter in "VEr") > 0, "there is no mode")
    require(modal.tets.min() >= 0 and modal.tets.max() < sizes["V"], "elements name nodes that there are none of")
    require(modal.part.min() >= 1 and modal.part.max() <= parts, "elements lie in parts that there are none of")


def check_prior(prior: MaterialPrior, sizes: Sizes) -> None:
    """Raises MisshapenError."""
    count = check(vars(prior), PRIOR, {name: sizes[name] for name in "HW"} | {"K": len(prior.name)})["K"]
    require(count > 0 and prior.index.min() >= 0 and prior.index.max() < count, "pixels name materials that there are none of")


def check_recovery(recovery: Recovery) -> None:
    """Raises MisshapenError."""
    sizes = check(vars(recovery), RECOVERY)
    check(recovery.damping.stored(), DAMPING)
    parts = sizes["n"]
    require(min(sizes[letter] for letter in "NTn") > 0, "there is no particle, frame or part")
    require(recovery.part.min() >= 1 and recovery.part.max() <= parts, f"numbers of parts lie beyond 1 .. {parts}")
    require(len(recovery.reasons) == parts and all(isinstance(reason, str) for reason in recovery.reasons), "there is not one reason per part")
    require(1 <= recovery.substeps <= 10**6, "substeps lie beyond 1 .. 1000000")
    _check_grid(recovery.grid)
    problem = recovery.simulation
    if isinstance(problem, ModalProblem):
        check(vars(problem), MODES, {"N": sizes["N"], "T": sizes["T"]})
    else:
        _check_mpm(problem, sizes)
        if problem.node is not None or problem.node_force is not None:
            require(problem.node is not None and problem.node_force is not None, "nodes and the forces on them go together")
            require(((problem.node >= 0) & (problem.node < np.prod(recovery.grid.size))).all(), "a force acts on nodes that the grid has not got")  # type: ignore[operator]


def _check_mpm(problem: MpmProblem, sizes: Sizes) -> None:
    check(vars(problem), MPM, {"T": sizes["T"], "t": sizes["T"] - 1})
    require(np.count_nonzero(~problem.ghost) == sizes["N"], "particles of the simulation are not those of the result")
    require((np.abs(problem.poisson) < 0.5).all(), "Poisson's ratio lies beyond 0.5")


def _check_grid(grid: Grid) -> None:
    check({"origin": grid.origin, "dx": grid.dx}, {"origin": "real 3", "dx": "positive"})
    require(len(grid.size) == 3 and all(isinstance(n, int) and n > 0 for n in grid.size), "grid_size is not of three numbers of nodes")
    require(grid.size[0] * grid.size[1] * grid.size[2] <= MOST_NODES, f"the grid has more than {MOST_NODES} nodes")
    require(-1 <= grid.clamp_index < grid.size[0], "grid_clamp_index lies outside the grid")


_KINDS = {"real": "f", "gap": "f", "positive": "f", "amount": "f", "number": "fiu", "whole": "iu", "truth": "b", "pixel": "u", "text": "U"}


def _check_one(name: str, array: np.ndarray, kind: str, axes: list[str], sizes: Sizes) -> None:
    """Adds to `sizes` what letters of the line stand for."""
    fits = len(axes) == array.ndim and all(length == (int(axis) if axis.isdigit() else sizes.setdefault(axis, length)) for axis, length in zip(axes, array.shape, strict=True))
    if not fits:
        wanted = ", ".join(f"{axis} = {sizes[axis]}" if axis in sizes else axis for axis in axes)
        raise MisshapenError(f"{name} is of shape {array.shape}, must be ({wanted})")
    allowed = _KINDS[kind] + ("iu" if not axes and _KINDS[kind] == "f" else "")  # one whole number may stand for a real one
    if array.dtype.kind not in allowed or (array.dtype.kind == "f" and array.itemsize not in (4, 8)) or (kind == "pixel" and array.itemsize != 1):
        raise MisshapenError(f"{name} is of {array.dtype}, must be {kind}")
    if kind in ("text", "truth", "pixel", "whole", "gap"):
        return
    if not (np.abs(array) <= LARGEST).all():
        raise MisshapenError(f"{name} must be finite and at most {LARGEST:g} everywhere")
    if (kind == "positive" and not (array > 0).all()) or (kind == "amount" and not (array >= 0).all()):
        raise MisshapenError(f"{name} must be {'> 0' if kind == 'positive' else '>= 0'} everywhere")
