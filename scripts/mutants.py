#!/usr/bin/env python3
"""Does the test suite notice faults? Puts the faults of tests/mutants into copies of the tree, one at a time, and runs the tests that
are meant to catch each. Exit status 0 only if all were noticed, 1 if one survived or crashed, 2 if a patch no longer applies or the
tests do not pass on the tree as it is.

A fault is noticed where an assertion in the body of a test fails. A fault that makes the program stop with an error has shown
nothing of what the tests measure; it is told as `crashed`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = Path("tests") / "mutants"
PACKAGE = "diffphys_ros"
LIMIT_S = 1800.0  # for the tests of one fault; then something hangs
NOTICED, SURVIVED, CRASHED = "noticed", "SURVIVED", "crashed"


class BrokenError(Exception):
    """What makes the whole run worthless; one sentence."""


@dataclass(frozen=True)
class Mutant:
    """One fault as a patch with a header of `# key: value` lines."""

    path: Path
    what: str  # the fault
    noticed_by: str  # the recovered quantity that moves beyond its bound
    tests: tuple[str, ...]  # pytest node ids

    @property
    def name(self) -> str:
        """Of the file, without its ending."""
        return self.path.stem

    @classmethod
    def read(cls, path: Path) -> Mutant:
        """Raises BrokenError where the header lacks a line."""
        lines = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
        pairs = [tuple(part.strip() for part in line.split(":", 1)) for line in lines if ":" in line]
        found = {key: [value for k, value in pairs if k == key] for key in ("what", "noticed by", "test")}
        missing = [key for key, values in found.items() if not values]
        if missing:
            raise BrokenError(f"{path}: the header has no line '# {missing[0]}: ...'")
        return cls(path, found["what"][0], found["noticed by"][0], tuple(found["test"]))


@dataclass(frozen=True)
class Failure:
    """A test that did not pass."""

    test: str
    message: str  # first line
    asserted: bool  # whether an assertion in the test's own file failed


@dataclass(frozen=True)
class Outcome:
    """What became of a fault."""

    mutant: Mutant
    state: str
    failure: Failure | None
    seconds: float

    @property
    def caught(self) -> str:
        """By which test, with its assertion."""
        return "" if self.failure is None else f"{self.failure.test}: {self.failure.message}"


def mutants(root: Path = ROOT, only: Sequence[str] = ()) -> list[Mutant]:
    """All faults, or those of the given names. Raises BrokenError for an unknown name."""
    found = {path.stem: path for path in sorted((root / FOLDER).glob("*.patch"))}
    unknown = sorted(set(only) - set(found))
    if unknown:
        raise BrokenError(f"{FOLDER}: there is no {unknown[0]}.patch; there are {', '.join(found)}")
    return [Mutant.read(found[name]) for name in only or found]


def copy_tree(root: Path, folder: Path) -> Path:
    """What git tracks or would track, as it lies there, links kept."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "-z", "-co", "--exclude-standard"], capture_output=True, text=True)
    if listed.returncode:
        raise BrokenError(f"{root}: {listed.stderr.strip() or 'not a git checkout'}")
    for name in filter(None, listed.stdout.split("\0")):
        if (root / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name, follow_symlinks=False)
    return folder


def apply(mutant: Mutant, folder: Path) -> None:
    """Patch a copy. Raises BrokenError where the patch does not fit any more."""
    alone = os.environ | {"GIT_CEILING_DIRECTORIES": str(folder.resolve().parent)}  # a checkout around the copy is none of its business
    done = subprocess.run(["git", "apply", str(mutant.path.resolve())], cwd=folder, env=alone, capture_output=True, text=True)
    if done.returncode:
        raise BrokenError(f"{mutant.path.name} no longer applies: {' '.join(done.stderr.split())}")


def run_tests(folder: Path, tests: Iterable[str]) -> tuple[int, list[Failure]]:
    """Status of pytest (-1: it took too long) in a copy of the tree, and what failed. Raises BrokenError where another tree would be tested."""
    environment = os.environ | {"PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    _check_place(folder, environment)
    report = folder / "report.xml"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--basetemp={folder / '.tests'}", f"--junitxml={report}", *tests]
    try:
        status = subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=LIMIT_S).returncode
    except subprocess.TimeoutExpired:
        return -1, []
    return status, _failures(report) if report.exists() else []


def _check_place(folder: Path, environment: dict[str, str]) -> None:
    code = f"import {PACKAGE}; print({PACKAGE}.__file__)"
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)
    place = done.stdout.strip()
    if done.returncode == 0 and not Path(place).resolve().is_relative_to(folder.resolve()):
        raise BrokenError(f"the tests would run on {place}, not on the copy in {folder}")


def _failures(report: Path) -> list[Failure]:
    return [_failure(case, fault) for case in ElementTree.parse(report).iter("testcase") for fault in case if fault.tag in ("failure", "error")]


def _failure(case: ElementTree.Element, fault: ElementTree.Element) -> Failure:
    file = case.get("classname", "").replace(".", "/") + ".py"
    message = " ".join((fault.get("message") or "").split())
    where = (fault.text or "").strip().splitlines()[-1:]  # path:line: exception
    asserted = fault.tag == "failure" and bool(where) and where[0].startswith(f"{file}:") and where[0].endswith(": AssertionError")
    return Failure(f"{file}::{case.get('name')}", message[:160], asserted)


def tried(mutant: Mutant, root: Path = ROOT) -> Outcome:
    """What becomes of a fault in a copy of the tree."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=f"mutant-{mutant.name}-") as temporary:
        folder = copy_tree(root, Path(temporary) / "tree")
        apply(mutant, folder)
        state, failure = judged(*run_tests(folder, mutant.tests))
    return Outcome(mutant, state, failure, time.monotonic() - began)


def judged(status: int, failures: Sequence[Failure]) -> tuple[str, Failure | None]:
    """The state of a fault by what its tests did, and the failure that says most."""
    if status == 0:
        return SURVIVED, None
    asserted = [failure for failure in failures if failure.asserted]
    if status == 1 and asserted:
        return NOTICED, asserted[0]
    return CRASHED, failures[0] if failures else Failure("pytest", f"ended with status {status}", False)


def check_unpatched(chosen: Sequence[Mutant], root: Path = ROOT) -> None:
    """Raises BrokenError where a patch does not apply or a test of theirs fails on the tree as it is."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as temporary:
        for mutant in chosen:
            apply(mutant, copy_tree(root, Path(temporary) / mutant.name))
            shutil.rmtree(Path(temporary) / mutant.name)
        folder = copy_tree(root, Path(temporary) / "tree")
        status, failures = run_tests(folder, dict.fromkeys(test for mutant in chosen for test in mutant.tests))
    if status:
        said = "; ".join(f"{failure.test}: {failure.message}" for failure in failures) or f"pytest ended with status {status}"
        raise BrokenError(f"without any fault the tests do not pass: {said}")


def table(outcomes: Iterable[Outcome]) -> str:
    """Markdown."""
    rows = [("fault", "what", "", "by which quantity", "caught by", "s"), ("---",) * 6]
    rows += [(o.mutant.name, o.mutant.what, o.state, o.mutant.noticed_by, o.caught, f"{o.seconds:.0f}") for o in outcomes]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n" for row in rows)


def told(outcome: Outcome) -> str:
    """One line for people."""
    return f"{outcome.state:9} {outcome.mutant.name:28} {outcome.seconds:5.0f} s  {outcome.caught or outcome.mutant.what}"


def main(arguments: Sequence[str], root: Path = ROOT) -> int:
    """All of it; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", nargs="*", help="faults to try; all where none is named")
    parser.add_argument("--jobs", type=int, default=1, help="faults tried at a time")
    parser.add_argument("--table", type=Path, help="Markdown file for the results")
    parser.add_argument("--list", action="store_true", help="say what there is and stop")
    options = parser.parse_args(arguments)
    try:
        chosen = mutants(root, options.name)
        if options.list:
            print("\n".join(f"{mutant.name:28} {mutant.what}" for mutant in chosen))
            return 0
        return _run(chosen, root, options.jobs, options.table)
    except BrokenError as error:
        print(f"mutants: {error}", file=sys.stderr)
        return 2


def _run(chosen: Sequence[Mutant], root: Path, jobs: int, path: Path | None) -> int:
    print(f"{len(chosen)} faults; first their tests on the tree as it is", flush=True)
    check_unpatched(chosen, root)
    outcomes = []
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        for outcome in pool.map(lambda mutant: tried(mutant, root), chosen):
            outcomes.append(outcome)
            print(told(outcome), flush=True)
    if path is not None:
        path.write_text(table(outcomes), encoding="utf-8")
    counts = {state: sum(o.state == state for o in outcomes) for state in (NOTICED, SURVIVED, CRASHED)}
    print("; ".join(f"{count} {state}" for state, count in counts.items()))
    return 0 if counts[NOTICED] == len(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
