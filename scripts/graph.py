#!/usr/bin/env python3
"""The sample, or a recording `bag:=` with its file of settings `config:=`, through the five nodes as five processes, fed by a sixth that publishes
its raw topics at the recorded rate, against fit_node with `bag:=` alone. Exit status 0 only if both give the same fields, bit for bit. Other
arguments are settings for fit_node on both sides: `scripts/graph.py fit.iterations:=1`."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from demo import BUDGET_S
from processes import environment, last_lines, module, node, run, shown, start, stop

from diffphys_ros import result
from diffphys_ros.bags.sample import sample_folder

OUT = Path("out/graph")
LIMIT_S = 600.0  # of either side
ITERATIONS = 8  # at most; a count that is given makes the fit forget the clock, which never ticks equally on both sides
LISTEN = module("diffphys_ros.nodes.listen", "--node", "fit_node", "--timeout", str(LIMIT_S))


def main(arguments: list[str]) -> int:
    """Both sides and their comparison; returns the exit status."""
    shutil.rmtree(OUT, ignore_errors=True)
    told = dict(word.split(":=", 1) for word in arguments)
    bag, given = told.pop("bag", sample_folder() / "clip.mcap"), {"config": told.pop("config", sample_folder() / "given.yaml")}
    solver = given | {"fit.time_budget_s": BUDGET_S, "fit.iterations": ITERATIONS} | told
    one = {"fit_node": node("fit_node", solver | {"bag": bag, "out": OUT / "one"})}
    five = {
        "fit_node": node("fit_node", solver | {"out": OUT / "five"}),
        "splat_node": node("splat_node", given),
        "segment_node": node("segment_node", given),
        "ingest_node": node("ingest_node", given | {"reliability": "reliable"}),
        "inspect_node": node("inspect_node", {"file": OUT / "inspect.rrd"}),
        "camera": module("diffphys_ros.nodes.replay", str(bag), "--inputs"),
    }
    good = all([play("one", one), play("five", five)])
    return 0 if good and print_comparison(OUT / "one", OUT / "five") else 1


def play(side: str, commands: dict[str, list[str]]) -> bool:
    """Runs these processes until fit_node has written its files; whether all ended well."""
    folder, began = result.check_writable(OUT / side), time.monotonic()
    print(f"\n{side}:", *(f"$ {shown(command)}" for command in commands.values()), sep="\n  ", flush=True)
    with ExitStack() as stack:
        logs = {name: folder.with_name(f"{side}_{name}.log") for name in commands}
        running = {name: start(command, stack.enter_context(logs[name].open("w"))) for name, command in commands.items()}
        try:
            heard = subprocess.run(LISTEN, env=environment(), timeout=LIMIT_S + 30).returncode == 0
            while heard and not (folder / result.FIGURE).exists() and time.monotonic() - began < LIMIT_S:
                time.sleep(0.2)
        finally:
            ended = {name: stop(process) for name, process in running.items()}
    failed = [name for name, status in ended.items() if status] or ([] if heard else ["fit_node"])
    for name in failed:
        print(f"graph: {name} ended with status {ended[name]}; {last_lines(logs[name])}", file=sys.stderr)
    print(f"{time.monotonic() - began:.0f} s", flush=True)
    return not failed and (folder / result.RECOVERY).exists()


def print_comparison(one: Path, five: Path) -> bool:
    """The largest difference of every array; whether all are equal."""
    first, second = (np.load(folder / result.RECOVERY) for folder in (one, five))
    print(f"\n{'array':24}{'largest difference':>20}")
    equal = set(first.files) == set(second.files)
    for name in first.files:
        a, b = first[name], second[name] if name in second.files else None
        same = b is not None and a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        equal &= same
        print(f"{name:24}{'equal' if same else _difference(a, b):>20}")
    return equal


def _difference(a: np.ndarray, b: np.ndarray | None) -> str:
    if b is None or a.shape != b.shape or a.dtype.kind not in "fiu":
        return "differs"
    return f"{np.nanmax(np.abs(a.astype(float) - b.astype(float))):.3g}"


if __name__ == "__main__":
    run(lambda: main(sys.argv[1:]))
