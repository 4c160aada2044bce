"""Results on disk: recovery.npz, metrics.json and what shows them (recovery.mcap, recovery.rrd, summary.png).

recovery.npz holds everything that a re-simulation needs, so that nothing is fitted twice: resimulate.simulate_again has the
trajectory from it. It depends on the input and the settings alone: no clock, no absolute path.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import config, npz, shapes, store
from . import folder as folders
from .damping import Damping
from .errors import InputError
from .folder import check_writable
from .footprints import Footprint
from .types import (
    PROBLEMS,
    Body,
    Camera,
    Clip,
    Doubt,
    Grid,
    Hanging,
    MaterialDoubt,
    MaterialPrior,
    ModalProblem,
    MpmProblem,
    Recovery,
    StartValues,
    Swing,
    Thickness,
    Tracks,
)

if TYPE_CHECKING:
    from .inverse.prepared import Prepared

RECOVERY, METRICS, RECORDING, RERUN, FIGURE = "recovery.npz", "metrics.json", "recovery.mcap", "recovery.rrd", "summary.png"
RECORDING_OUTLINE = "metadata.yaml"  # rosbag2's, beside the recording: with it the result folder is one for `ros2 bag`
FILES = (RECOVERY, METRICS, RECORDING, RECORDING_OUTLINE, RERUN, FIGURE)
CHECKPOINT = "checkpoint.npz"  # beside them while a fit runs, and after one that was interrupted
MOST_METRICS_BYTES = 2**26  # of metrics.json

_FIELDS = ("points", "volume", "part", "log10_young_sd", "poisson", "density", "poisson_sd", "density_sd", "young_lower", "log10_specific_sd", "force", "net_force_sd", "trajectory", "clamped")
_FRAME = ("initial_velocity", "world_from_body", "gravity")
_SCALARS = ("net_force_peak", "net_force_peak_sd", "apparent_stiffness", "period_s", "substeps")


def owned(folder: str | Path) -> AbstractContextManager[Path]:
    """Own a result folder while a run works in it; see folder.owned. Raises InputError where another run does, and for the folder of
    another recording, whose metadata.yaml would be lost."""
    outline = Path(folder) / RECORDING_OUTLINE
    if outline.exists() and RECORDING not in outline.read_text(encoding="utf-8", errors="replace"):
        raise InputError(f"output folder {folder}: holds a rosbag2 recording, whose {RECORDING_OUTLINE} would be lost; choose another folder with --out")
    return folders.owned(folder, files=(*FILES, CHECKPOINT))


def save(recovery: Recovery, clip: Clip, settings: config.Settings, folder: str | Path) -> Path:
    """Write recovery.npz and metrics.json into `folder`; returns the path of the former.

    Arrays of recovery.npz (T frames, N particles, world frame, SI units): points (N, 3), volume, part, young (NaN where the
    part is not identified), young_solver (as simulated: before the grid's correction), log10_young_sd, poisson, density,
    poisson_sd and density_sd (0 where they were told), young_lower (the least modulus, where that is all that is known), log10_specific_sd (of log10(young / density)), clamped (N,),
    force [N/m^3 of rest volume] and trajectory (T, N, 3), net_force and net_force_sd [N] (T, 3), net_force_peak and net_force_peak_sd [N],
    absolute and scale (whether E and force are in pascals and newtons, and in words what holds where a density or a size is assumed: then young, young_lower
    and force are those of a body of that density and size), frames (T, H, W, 3) where rendered,
    initial_velocity (N, 3), identified (n,), reasons (n,), force_identified, force_reason, period_s, start_ns, stamps_ns (T,), frame_id, config (JSON of
    dotted settings).

    For a re-simulation, in the body frame, whose pose is world_from_body (4, 4): gravity (3,), grid_origin (3,), grid_dx,
    grid_size (3,), grid_clamp_index, substeps, mass_damping [1/s], stiffness_damping [s], apparent_stiffness
    (E_apparent / E), engine ("mpm" or "modes": what made the trajectory) and, as mpm_NAME or modes_NAME, the fields of
    types.MpmProblem (P particles, ghosts among them) or types.ModalProblem.
    """
    folder = check_writable(folder)
    path = store.write_arrays(folder / RECOVERY, _arrays(recovery, clip, settings))
    write_metrics(folder, recovery.metrics | {"scale": recovery.scale.words, "notes": list(recovery.notes)})
    return path


def load(folder: str | Path) -> Recovery:
    """The Recovery that `save` wrote into `folder`. Raises InputError where there is none or its arrays do not fit each other."""
    path = folders.current(folder, RECOVERY)
    z = store.read_arrays(path, "recovery", cure="recover the clip again")
    metrics = read_metrics(folder)
    notes = metrics.pop("notes", [])
    metrics.pop("scale", None)  # it follows from what fixed density and size
    try:
        recovery = _recovery(z, path, metrics, tuple(str(note) for note in notes) if isinstance(notes, list) else ())
        shapes.check_recovery(recovery)
    except KeyError as error:
        raise InputError(f"recovery {path}: array {error} is missing; recover the clip again") from error
    except shapes.MisshapenError as error:
        raise InputError(f"recovery {path}: {error}; recover the clip again") from error
    return recovery


def _recovery(z: dict[str, np.ndarray], path: Path, metrics: dict[str, Any], notes: tuple[str, ...]) -> Recovery:
    """Raises KeyError for an array that is missing, shapes.MisshapenError for one of another shape."""
    shapes.check(z, {"grid_dx": "positive", "grid_size": "whole 3", "grid_clamp_index": "whole", "reasons": "text n", "force_identified": "truth", "force_reason": "text"} | {name: shapes.RECOVERY[name] for name in _SCALARS} | shapes.DAMPING)
    fields: dict[str, Any] = {name: z[name] for name in (*_FIELDS, *_FRAME, "young", "identified")}
    return Recovery(
        **fields,
        **{name: z[name].item() for name in _SCALARS},
        damping=Damping.of_stored(z),
        simulation=_simulation(z, path),
        frames=z.get("frames"),
        grid=store.built(Grid, z, "grid_"),
        reasons=tuple(z["reasons"].tolist()),
        metrics=metrics,
        notes=notes,
        force_identified=bool(z["force_identified"]),
        force_reason=str(z["force_reason"]),
    )


def _simulation(z: dict[str, np.ndarray], path: Path) -> MpmProblem | ModalProblem:
    """The initial value problem of a recovery.npz. Raises InputError, KeyError for an array that is missing."""
    engine = str(z["engine"])
    if engine not in PROBLEMS:
        raise InputError(f"recovery {path}: engine {engine[:40]!a} is unknown, must be one of {', '.join(PROBLEMS)}; recover the clip again")
    problem: MpmProblem | ModalProblem = store.built(PROBLEMS[engine], z, f"{engine}_")
    return problem


def write_all(
    recovery: Recovery,
    clip: Clip,
    settings: config.Settings,
    folder: str | Path,
    *,
    splats: Any = None,
    node: str = "fit_node",
    report: Callable[[str], None] = lambda text: None,
) -> list[str]:
    """Everything `save` writes, then recording, rerun file and figure: all of them take the place of a former run's together, or none.

    Call it while the folder is `owned`. `node` is whose topics the recording holds, with its namespace. `report` is told each file as it is begun. Returns one sentence for each file that was left
    out because a package it needs is not installed, or not usable (one that wants another numpy). Raises InputError where the disc is full.
    """
    left_out = []
    resumable = "; the checkpoint stays: --resume (of fit_node: resume) goes on from it" if (Path(folder) / CHECKPOINT).exists() else ""
    with folders.replaced(folder, FILES, then=resumable) as staging:
        save(recovery, clip, settings, staging)
        for name, write in _exports(recovery, clip, settings, splats, node):
            report(name)
            try:
                write(staging / name)
            except ImportError as error:
                if (error.name or "").split(".")[0] == "diffphys_ros":
                    raise
                why = f"the package {error.name!r} is not installed" if isinstance(error, ModuleNotFoundError) else f"a package that it needs cannot be used here ({error})"
                left_out.append(f"{name} was left out because {why}.")
    return left_out


def save_prepared(path: str | Path, prepared: Prepared, settings: config.Settings) -> Path:
    """The clip.npz from which a machine with only torch, numpy, scipy and Warp goes on; holds the settings as well."""
    return store.save(path, {"prepared": prepared, "settings": _portable(settings)})


def load_prepared(path: str | Path) -> Prepared:
    """The prepared clip that `save_prepared` wrote. Raises InputError for a file of another kind."""
    return _stored(path)["prepared"]


def stored_settings(path: str | Path) -> dict[str, Any]:
    """Settings by dotted name under which `save_prepared` wrote the file. Raises InputError for a file of another kind."""
    return _stored(path)["settings"]


def _stored(path: str | Path) -> dict[str, Any]:
    from .inverse.prepared import Prepared
    from .modes.model import ModalModel
    from .start.zones import Zoned

    found = store.load(path, (Prepared, Zoned, ModalModel, Camera, Clip, Thickness, Doubt, Tracks, Body, StartValues, MaterialDoubt, Footprint, MaterialPrior, Hanging, Swing))
    if not (isinstance(found, dict) and isinstance(found.get("prepared"), Prepared) and isinstance(found.get("settings"), dict)):
        raise InputError(f"clip {path}: holds no prepared clip; write one with 'diffphys ingest CLIP --out clip.npz'")
    if found["settings"].keys() != config.leaves().keys():
        raise InputError(f"clip {path}: holds settings of another version; write it again with 'diffphys ingest'")
    try:
        found["prepared"].check()
    except shapes.MisshapenError as error:
        raise InputError(f"clip {path}: {error}; write it again with 'diffphys ingest'") from error
    return found


def write_metrics(folder: str | Path, metrics: dict[str, object]) -> Path:
    """metrics.json; numbers that are not finite become null."""
    text = json.dumps(_plain(metrics), indent=1) + "\n"
    return store.write_whole(Path(folder) / METRICS, lambda path: path.write_text(text, encoding="utf-8"))


def read_metrics(folder: str | Path) -> dict[str, Any]:
    """What metrics.json of a result folder holds; empty where there is none. Raises InputError for a broken one."""
    path = folders.current(folder, METRICS)
    try:
        with npz.open_regular(path) as file:
            text = file.read(MOST_METRICS_BYTES)
        found = json.loads(text)
        if not isinstance(found, dict):
            raise npz.DamagedError("it is no object of JSON")
        return found
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError, npz.DamagedError) as error:
        raise InputError(f"metrics {path}: {npz.in_words(error)}; recover the clip again") from error


def _exports(recovery: Recovery, clip: Clip, settings: config.Settings, splats: Any, node: str) -> Iterator[tuple[str, Callable[[Path], object]]]:
    # Imported late: a machine that only solves has none of these packages.
    scale = recovery.scale.taken(settings.publish.allow_assumed_scale)

    def recording(path: Path) -> object:
        from .bags.write import write_recording
        from .msg_schemas import recording as messages

        return write_recording(path, messages(recovery, clip, settings, node=node), outline=True)

    def rerun_file(path: Path) -> object:
        from .report.rerun_log import write_rrd

        return store.write_whole(path, lambda temporary: write_rrd(temporary, recovery, clip, splats=splats, scale=scale))

    def figure(path: Path) -> object:
        from .report.figure import summary

        return store.write_whole(path, lambda temporary: summary(temporary, recovery, clip, scale=scale))

    return iter(((RECORDING, recording), (RERUN, rerun_file), (FIGURE, figure)))


def _arrays(recovery: Recovery, clip: Clip, settings: config.Settings) -> dict[str, Any]:
    rendered = {} if recovery.frames is None else {"frames": recovery.frames}
    return {
        **{name: getattr(recovery, name) for name in _FIELDS},
        "net_force": recovery.net_force(),
        "young": np.where(recovery.identified[recovery.part - 1], recovery.young, np.nan),
        "young_solver": recovery.young_solver,
        **rendered,
        **{name: getattr(recovery, name) for name in _FRAME},
        **store.flat(recovery.grid, "grid_"),
        **{name: getattr(recovery, name) for name in _SCALARS},
        **recovery.damping.stored(),
        "identified": recovery.identified,
        "reasons": np.array(recovery.reasons),
        "force_identified": recovery.force_identified,
        "force_reason": np.array(recovery.force_reason),
        "absolute": recovery.scale.absolute,
        "scale": np.array(recovery.scale.words),
        "engine": np.array(recovery.simulation.engine),
        **store.flat(recovery.simulation, f"{recovery.simulation.engine}_"),
        "start_ns": clip.start_ns,
        "stamps_ns": clip.start_ns + np.rint(clip.times * 1e9).astype(np.int64),
        "frame_id": np.array(clip.camera.world_frame_id or clip.camera.frame_id),
        "config": np.array(json.dumps(_portable(settings))),
    }


def _portable(settings: config.Settings) -> dict[str, Any]:
    """Dotted settings whose files are named without the folder they happened to lie in."""
    leaves = config.leaves()
    return {name: Path(value).name if leaves[name].path and value else value for name, value in config.flat(settings).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
