"""Which tests notice a number: those that fail where it is multiplied.

    python benchmarks/noticed.py NUMBER... [--tests PATH...] [--factors 0.01 0.5 2 100] [--jobs N]

A number is written as docs/measurements/sensitivity.md calls it. The tests are those of its room, unless others are given; each factor is a
process of its own, and one that runs longer than TIMEOUT_S is an outcome as well. Prints a line for each number and factor.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from deciding import Number, multiply

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT_S = 600.0
CHILD = "--child"  # first word of a process that runs tests with a number multiplied
HERE = {"plainness": ("tests/segment/test_even.py", "tests/outline"), "outline": ("tests/outline",), "segment": ("tests/segment/test_even.py", "tests/outline")}


def failing(number: Number, tests: list[str], factor: float) -> list[str]:
    """Tests that fail, the first three of them; a sentence where they did not end."""
    command = [sys.executable, __file__, CHILD, number.module, number.path, str(factor), *tests]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return [f"no end within {TIMEOUT_S:g} s"]
    found = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)
    return found if done.returncode in (0, 1) else [*found, f"pytest ended with {done.returncode}"]


def child(module: str, path: str, factor: str, tests: list[str]) -> int:
    """Runs tests in this process, which must have imported nothing of the library yet."""
    multiply(Number.of(module, path), float(factor))
    import pytest

    return int(pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--maxfail=3", "--tb=no", "-rfE", *tests]))


def main() -> int:
    """Prints what fails; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("numbers", nargs="+", metavar="NUMBER", help="such as start.force.FORCE_SD")
    parser.add_argument("--tests", nargs="+", default=[], help="files or folders, in place of those of the room")
    parser.add_argument("--factors", nargs="+", type=float, default=[0.5, 2.0])
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    options = parser.parse_args()
    with ThreadPoolExecutor(options.jobs) as pool:
        for word in options.numbers:
            module, _, path = word.rpartition(".")
            room = module.partition(".")[0]
            tests = options.tests or list(HERE.get(room, (f"tests/{room}",)))
            number = Number.of(module, path)
            for factor, found in zip(options.factors, pool.map(partial(failing, number, tests), options.factors), strict=True):
                print(f"{word} x{factor:g}: {', '.join(found) or 'nobody notices'}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(child(*sys.argv[2:5], sys.argv[5:]) if sys.argv[1:2] == [CHILD] else main())
