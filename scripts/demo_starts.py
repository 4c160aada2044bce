#!/usr/bin/env python3
"""Does the answer depend on where the search began? Repeats the recovery of the bundled sample with the modal search begun
3x and 0.3x off, then the solver alone begun 1.3x and 0.77x off the start values. Exit status 0 only if every Young's
modulus agrees within SPREAD over all runs."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from demo import BUDGET_S
from processes import PROGRAMS, run, shown

from diffphys_ros import result
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.report.colours import pascals

OUT = Path("out/demo-starts")
SPREAD = 0.05
WHOLE_RUNS = {
    "as it is": [],
    "modal search from 3x": ["--modes.start_scale", "3"],
    "modal search from 0.3x": ["--modes.start_scale", "0.3"],
}
SOLVER_RUNS = {"solver from 1.3x": ["--fit.start_scale", "1.3"], "solver from 0.77x": ["--fit.start_scale", "0.77"]}


def main() -> int:
    """All runs and their table; returns the exit status."""
    clip, given, prepared = sample_folder() / "clip.mcap", ["--config", str(sample_folder() / "given.yaml")], OUT / "clip.npz"
    young = {name: recover(clip, name, [*given, *flags]) for name, flags in WHOLE_RUNS.items()}
    diffphys("ingest", str(clip), "--out", str(prepared), *given)
    young |= {name: recover(prepared, name, flags) for name, flags in SOLVER_RUNS.items()}
    return print_table(young)


def recover(clip: Path, name: str, flags: list[str]) -> np.ndarray:
    """Young's modulus by part [Pa] of one run."""
    out = OUT / name.replace(" ", "_")
    diffphys("recover", str(clip), "--out", str(out), "--fit.time_budget_s", str(BUDGET_S), *flags)
    found = result.load(out)
    return np.array([np.median(found.young[found.part == part]) for part in range(1, len(found.identified) + 1)])


def diffphys(*arguments: str) -> None:
    """Runs the command line tool; stops everything where it fails."""
    command, began = [str(PROGRAMS / "diffphys"), *arguments], time.monotonic()
    print(f"\n$ {shown(command)}", flush=True)
    status = subprocess.run(command).returncode
    if status:
        sys.exit(status)
    print(f"{time.monotonic() - began:.0f} s", flush=True)


def print_table(young: dict[str, np.ndarray]) -> int:
    """Young's moduli of all runs and their spread; 0 where that is within SPREAD, else 1."""
    counts = {len(values) for values in young.values()}
    if len(counts) != 1:
        print(f"demo-starts: the runs found different numbers of parts ({sorted(counts)})", file=sys.stderr)
        return 1
    table = np.array(list(young.values()))
    print(f"\n{'':24}" + "".join(f"{f'part {part}':>14}" for part in range(1, table.shape[1] + 1)))
    for name, values in young.items():
        print(f"{name:24}" + "".join(f"{pascals(value):>14}" for value in values))
    spread = table.max(0) / table.min(0) - 1
    print(f"{'spread':24}" + "".join(f"{f'{100 * share:.1f} %':>14}" for share in spread))
    good = bool((spread <= SPREAD).all())  # NaN, a part that is not identified, counts as bad
    print(f"{'ok' if good else 'short'}: at most {100 * SPREAD:.0f} %")
    return 0 if good else 1


if __name__ == "__main__":
    run(main)
