#!/usr/bin/env python3
"""Does the answer depend on where the search began? Repeats the recovery of the bundled sample with the modal search begun
3x and 0.3x off, then the solver alone begun 1.3x and 0.77x off the start values. Exit status 0 only if every Young's
modulus agrees within SPREAD over all runs, and every answer is a simulation that is nearer to the true motion than the start
values are: these agree with each other whatever the solver does."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from demo import BUDGET_S
from processes import PROGRAMS, run, shown

from diffphys_ros import result
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.colours import pascals

OUT = Path("out/demo-starts")
SPREAD = 0.05
TRAJECTORY = 0.042  # rms error over rms motion; the linear motion of the start values is .045 off
WHOLE_RUNS = {
    "as it is": [],
    "modal search from 3x": ["--guess_scale", "3"],
    "modal search from 0.3x": ["--guess_scale", "0.3"],
}
SOLVER_RUNS = {"solver from 1.3x": ["--start_scale", "1.3"], "solver from 0.77x": ["--start_scale", "0.77"]}


def main() -> int:
    """All runs and their table; returns the exit status."""
    clip, given, prepared = sample_folder() / "clip.mcap", ["--config", str(sample_folder() / "given.yaml")], OUT / "clip.npz"
    young = {name: recover(clip, name, [*given, *flags]) for name, flags in WHOLE_RUNS.items()}
    diffphys("ingest", str(clip), "--out", str(prepared), *given)
    young |= {name: recover(prepared, name, flags) for name, flags in SOLVER_RUNS.items()}
    agreed = print_table(young)
    simulated = print_simulated({name: result.read_metrics(folder_of(name)) for name in young})
    return agreed or simulated


def folder_of(name: str) -> Path:
    """Of the results of a run."""
    return OUT / name.replace(" ", "_")


def recover(clip: Path, name: str, flags: list[str]) -> np.ndarray:
    """Young's modulus by part [Pa] of one run, which is scored as well."""
    out = folder_of(name)
    diffphys("recover", str(clip), "--out", str(out), "--fit.time_budget_s", str(BUDGET_S), *flags)
    diffphys("score", str(out), "--truth", str(sample_folder() / "truth.npz"))
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


def print_simulated(metrics: dict[str, dict[str, Any]]) -> int:
    """How near each answer is to the true motion; 0 where all are simulated and within TRAJECTORY, else 1."""
    good = True
    for name, found in metrics.items():
        error = found["trajectory_rmse_over_rms_motion"]
        here = found["refined"] and error <= TRAJECTORY
        words = "simulated" if found["refined"] else "start values"
        print(f"{name:24} {words:>14} {f'motion {100 * error:.1f} % off':>20}  {'ok' if here else 'short'}: simulated, at most {100 * TRAJECTORY:.1f} %")
        good = good and here
    return 0 if good else 1


if __name__ == "__main__":
    run(main)
