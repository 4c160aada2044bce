"""What the strongest of the first engine's numbers do to whole recoveries: each halved and doubled, against the truth.

    python benchmarks/whole_runs.py FOLDER... [--most N] [--jobs N] [--set KEY=VALUE...] [--record [--dirty]]

A folder holds clip.mcap, given.yaml and truth.npz, as bags/sample does. The numbers are the first N of the table of benchmarks/sensitivity.py,
whose rows must be there. --set gives further settings, such as a coarser grid. --record keeps the rows in
benchmarks/results/whole_runs.json and writes the table of docs/measurements/sensitivity.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import Any

import deciding
from clips import this_commit
from deciding import Number
from notes import CHANGED, NOTES, RESULTS, filled, ranked

from diffphys_ros import score
from diffphys_ros.batch.machine import device_name, versions
from diffphys_ros.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
ROWS = RESULTS / "whole_runs.json"
FACTORS = dict(zip(CHANGED, (0.5, 2.0), strict=True))
CHILD = "--recover"  # first word of a process that recovers with a number multiplied

Figures = dict[str, float | None]


def recovered(folder: Path, number: Number | None, factor: float, settings: Sequence[str]) -> Figures | str:
    """Largest |log10 E| error, force cosine and trajectory error of a whole recovery in a process of its own; a sentence where it failed."""
    with tempfile.TemporaryDirectory() as out:
        words = [folder / "clip.mcap", "--config", folder / "given.yaml", "--out", out, *chain.from_iterable(f"--{pair}".split("=", 1) for pair in settings)]
        multiplied = [] if number is None else [number.module, number.path, factor]
        command = [sys.executable, __file__, CHILD, json.dumps(multiplied), *words]
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}, check=False)
        if done.returncode:
            return (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1][:80]
        found: dict[str, Any] = score.score_folder(out, folder / "truth.npz")
    errors = [abs(e) for e in found["young_log10_error"] if e is not None]
    return {"young": max(errors, default=None), "cosine": found["net_force_cosine"], "trajectory": found["trajectory_rmse_over_rms_motion"]}


def strongest(most: int) -> list[Number]:
    """The first of the table of sensitivity.py. Raises InputError without its rows."""
    path = RESULTS / "sensitivity.json"
    if not path.exists():
        raise InputError(f"{path}: there are no rows; run benchmarks/sensitivity.py --record first")
    known = {str(number): number for number in deciding.numbers()}
    return [known[row["name"]] for row in ranked(json.loads(path.read_text())) if row["name"] in known][:most]


def measured(folders: Sequence[Path], chosen: Sequence[Number], settings: Sequence[str], jobs: int) -> list[dict[str, Any]]:
    """A row without a name for the numbers as they are, and one for each of the chosen."""
    asked = [(None, "as is", 1.0), *((number, word, factor) for number in chosen for word, factor in FACTORS.items())]
    rows: dict[str, dict[str, Any]] = {}
    with ThreadPoolExecutor(jobs) as pool:
        running = {(n, word, folder): pool.submit(recovered, folder, n, factor, settings) for n, word, factor in asked for folder in folders}
        for (number, word, folder), found in running.items():
            print(f"{number or 'all numbers'} {word}, {folder.name}: {found.result()}", file=sys.stderr)
            rows.setdefault(str(number or ""), {"name": str(number or "")}).setdefault(word, {})[folder.name] = found.result()
    return list(rows.values())


def main(arguments: Sequence[str]) -> int:
    """Measures, and keeps the rows where that is asked for; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--most", type=int, default=10, help="numbers")
    parser.add_argument("--jobs", type=int, default=1, help="recoveries at once")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a further setting")
    parser.add_argument("--record", action="store_true", help="keep the rows and write the table")
    parser.add_argument("--dirty", action="store_true", help="record although files differ from the commit; the rows say so")
    options = parser.parse_args(arguments)
    try:
        about = {"device": device_name("cpu"), "versions": versions(), "commit": this_commit(dirty=options.dirty)} if options.record else {}
        rows = measured(options.folders, strongest(options.most), options.set, options.jobs)
    except InputError as problem:
        print(f"whole_runs: {problem}", file=sys.stderr)
        return 2
    if options.record:
        ROWS.write_text(json.dumps([row | about for row in rows], indent=1) + "\n")
        page = NOTES / "sensitivity.md"
        page.write_text(filled(page.read_text()))
    return 0


def child(multiplied: str, words: Sequence[str]) -> int:
    """`diffphys recover WORDS` with a number multiplied; whatever imports the solver comes after that."""
    if what := json.loads(multiplied):
        module, path, factor = what
        deciding.multiply(Number.of(module, path), factor)
    from diffphys_ros.__main__ import main as diffphys

    return diffphys(["recover", *words])


if __name__ == "__main__":
    sys.exit(child(sys.argv[2], sys.argv[3:]) if sys.argv[1:2] == [CHILD] else main(sys.argv[1:]))
