"""Simpler ways to a stiffness, on the same clips: what each says of E, and how far it is off.

    python benchmarks/baselines.py OUT --clips FOLDER... [--ours RESULTS] [--batch --workers 2]    # goes on where it was interrupted
    python benchmarks/baselines.py OUT --clips FOLDER... [--ours RESULTS] --record    # rows into benchmarks/results, table into docs/how_sure.md
    python benchmarks/baselines.py --tables | --check

A folder of clips holds clip.mcap, given.yaml and truth.npz, or folders of such. Ours is a run of `diffphys batch` with all defaults, RESULTS where there
is one. The others:
- first frequency: one E for the whole object, at which its first mode swings as fast as the film shows. Shape, clamp and frequency are those of
  our own front end, and the mass is told. This is what visual vibrometry does (Davis et al. 2015).
- modes only: our first engine without the simulation (`experiment.schedule linear`).
- the paper's loss alone: config/paper.yaml, pictures and the force's smoothness. It calls no E identified; the table has the one it simulates with.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from clips import ROOT, batched, this_commit
from notes import RESULTS, refilled
from scipy.optimize import brentq

sys.path.insert(0, str(ROOT))  # started as a file, it would not find tools/

from diffphys_ros import config, result
from diffphys_ros.bags.read import read_clip
from diffphys_ros.batch import read_status
from diffphys_ros.batch.machine import device_name, versions
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import prepare
from diffphys_ros.modes import ModalModel
from diffphys_ros.progress import finished
from tools.paper.rows import young_errors

FREQUENCY, MODES, PAPER, OURS = METHODS = ("first frequency", "modes only", "the paper's loss alone", "ours")
BATCHES: dict[str, tuple[str, ...]] = {OURS: (), MODES: ("--experiment.schedule", "linear"), PAPER: ("--config", str(ROOT / "config" / "paper.yaml"))}
FOLDERS = {MODES: "modes", PAPER: "paper", OURS: "ours"}
FREQUENCIES = "frequency.json"  # in OUT: of_frequency by clip
ROWS, PAGE = RESULTS / "baselines.json", ROOT / "docs" / "how_sure.md"
BEGIN, END = "<!-- baselines -->", "<!-- end baselines -->"
HEAD = ("", "clips", "part at the clamp, size of the error of log10 E: median, 90 %", "outer parts: median", "net force, median cosine", "trajectory, rms error over rms motion: median")
DECADES = 6.0  # of E about the elements' in which a frequency is looked for

Row = dict[str, Any]


def of_frequency(clip: Path) -> list[float] | None:
    """log10 of the first frequency's E over the true one, by part; None where the film shows no frequency."""
    with np.load(clip / "truth.npz") as truth:
        true, mass = truth["part_E"], float(truth["vertex_mass"].sum())
    told = {key: value for key, value in config.read_yaml(clip / "given.yaml").items() if key != "scene.density_kg_m3"}
    settings = config.build(told | {"scene.mass_kg": mass, "segment.max_parts": 1, "experiment.schedule": "linear"})
    made = finished(prepare(read_clip(clip / "clip.mcap", settings, frames=settings.frames), settings))
    if not len(made.start.observed_hz):
        return None
    errors: list[float] = np.log10(swinging_at(made.modal, float(made.start.observed_hz[0])) / true).tolist()
    return errors


def swinging_at(modal: ModalModel, hz: float) -> float:
    """Young's modulus [Pa] at which the first mode of a body of one material has this frequency. What gravity's prestress adds is counted."""

    def too_fast(log10: float) -> float:
        omega2 = modal.eigen(np.full(len(modal.reference), 10.0**log10))[0][0]
        return float(omega2 - (2 * np.pi * hz) ** 2)

    middle = float(np.log10(modal.reference[0]))
    return float(10.0 ** brentq(too_fast, middle - DECADES, middle + DECADES))


def run(out: Path, clips: Sequence[Path], ours: Path | None, words: Sequence[str]) -> int:
    """Every method that has no result yet; returns the worst exit status."""
    out.mkdir(parents=True, exist_ok=True)
    path, worst = out / FREQUENCIES, 0
    known = json.loads(path.read_text()) if path.exists() else {}
    for clip in clips:
        if clip.name not in known:
            known[clip.name] = of_frequency(clip)
            path.write_text(json.dumps(known))
            print(f"{clip.name}: {FREQUENCY} {known[clip.name]}", flush=True)
    for method, flags in BATCHES.items():
        if method == OURS and ours is not None:
            continue
        worst = max(worst, batched(clips, out / FOLDERS[method], [*flags, *words]))
    return worst


def rows_of(out: Path, clips: Sequence[Path], ours: Path | None, commit: str) -> list[Row]:
    """A row for every clip and method. Raises InputError where a run of ours or of another is missing."""
    known = json.loads((out / FREQUENCIES).read_text()) if (out / FREQUENCIES).exists() else {}
    rows: list[Row] = []
    about = {"device": device_name("cpu"), "versions": versions(), "commit": commit}
    for clip in clips:
        if clip.name not in known:
            raise InputError(f"{out}: {clip.name} has no {FREQUENCY}; run without --record first")
        rows.append({"clip": clip.name, "method": FREQUENCY, "young": known[clip.name] or [], **about})
        rows += [_of_batch(clip, ours if ours and method == OURS else out / folder, method, commit) for method, folder in FOLDERS.items()]
    return rows


def _of_batch(clip: Path, results: Path, method: str, commit: str) -> Row:
    folder = next(iter(sorted(results.glob(f"{clip.name}-*"))), None)
    status = read_status(folder) if folder else None
    if folder is None or status is None or status.state in ("waiting", "running", "interrupted"):
        raise InputError(f"{results}: {clip.name} has not ended there; run the same command again")
    errors: Iterable[float | None] = status.figures.get("young_log10_error") or []
    if method == PAPER and status.state == "done":
        errors = young_errors(result.load(folder), clip / "truth.npz")
    figures = {"cosine": status.figures.get("net_force_cosine"), "trajectory": status.figures.get("trajectory_rmse_over_rms_motion")}
    return {"clip": clip.name, "method": method, "young": list(errors), **figures, "device": status.device, "versions": status.versions, "commit": commit}


def table(rows: Sequence[Row]) -> str:
    """One line a method, in markdown."""
    lines = [HEAD, ("---",) * len(HEAD)]
    for method in METHODS:
        of = [row for row in rows if row["method"] == method]
        clamp = [abs(row["young"][0]) for row in of if row["young"] and row["young"][0] is not None]
        outer = [abs(e) for row in of for e in row["young"][1:] if e is not None]
        shares = [", ".join(f"{np.percentile(clamp, p):.3f}" for p in (50, 90)) if clamp else "-", _median(outer, ".3f")]
        lines.append((method, str(len(of)), *shares, _median([row.get("cosine") for row in of], ".3f"), _median([row.get("trajectory") for row in of], ".3f")))
    made_on = "; ".join(dict.fromkeys(f"{row['device']}, {row['versions']}, commit {row['commit']}" for row in rows))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + f"\n\n{made_on}"


def _median(values: Iterable[float | None], form: str) -> str:
    known = [value for value in values if value is not None]
    return f"{np.median(known):{form}}" if known else "-"


def filled(text: str) -> str:
    """The page with its table made from the stored rows."""
    if not ROWS.exists():
        return text
    before, _, rest = text.partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        raise InputError(f"{PAGE.name}: has no place {BEGIN} ... {END}")
    return f"{before}{BEGIN}\n{table(json.loads(ROWS.read_text()))}\n{END}{after}"


def _clips(folders: Iterable[Path]) -> list[Path]:
    found = sorted({path.parent for folder in folders for path in folder.rglob("truth.npz") if (path.parent / "given.yaml").exists()})
    if not found:
        raise InputError("--clips: holds no clip with a truth.npz and a given.yaml beside it")
    return found


def main(arguments: Sequence[str]) -> int:
    """Runs, records or writes; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, help="folder of the results")
    parser.add_argument("--clips", nargs="+", type=Path, default=[], metavar="FOLDER")
    parser.add_argument("--ours", type=Path, metavar="RESULTS", help="of diffphys batch on the same clips")
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--dirty", action="store_true", help="record although files differ from the commit")
    parser.add_argument("--tables", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--batch", nargs=argparse.REMAINDER, default=[], help="further words for diffphys batch; last")
    options = parser.parse_args(arguments)
    try:
        if not (options.tables or options.check) and options.out is None:
            raise InputError("give a folder for the results")
        if options.record:
            ROWS.write_text(json.dumps(rows_of(options.out, _clips(options.clips), options.ours, this_commit(dirty=options.dirty)), indent=1) + "\n")
        elif not (options.tables or options.check):
            return run(options.out, _clips(options.clips), options.ours, options.batch)
    except InputError as error:
        print(f"baselines: {error}", file=sys.stderr)
        return 2
    return refilled([PAGE], filled, check=options.check)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
