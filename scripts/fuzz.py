#!/usr/bin/env python3
"""Hostile input for every door of the product, by seeds: the modules of tests/fuzz, or files of that kind. Each case ends "taken" or
"refused"; anything else is a fault: an exception, a hang, a crash, memory, a file outside its folder, a RuntimeWarning of our code.
Exit status 0 only if there was none, 1 if there was one, 2 for a door that does not exist."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import math
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from mmap import mmap
from pathlib import Path
from types import ModuleType

from fuzz_case import AT, BEGAN_NS, CASES, DONE, REFUSED, ROOT, SLOTS, TAKEN, Limits, work
from tqdm import tqdm

FOLDER = ROOT / "tests" / "fuzz"
POLL_S = 0.02
MOST_FAULTS = 100  # then the rest of a door is left
SHOWN = 25


class BrokenError(Exception):
    """What makes the run worthless; one sentence."""


@dataclass(frozen=True)
class Fault:
    """A case that ended otherwise than it may."""

    door: str
    seed: int
    what: str

    def __str__(self) -> str:
        return f"FAULT  {self.door} seed {self.seed}: {self.what}"


@dataclass
class Outcome:
    """What came of a door."""

    door: str
    taken: int = 0
    refused: int = 0
    faults: list[Fault] = field(default_factory=list)
    left_out: str = ""  # why it did not run
    seconds: float = 0.0

    def __str__(self) -> str:
        if self.left_out:
            return f"{self.door:12} left out: {self.left_out}"
        return f"{self.door:12} {self.taken:7} taken {self.refused:7} refused {len(self.faults):5} faults {self.seconds:7.0f} s"


def doors(folder: Path = FOLDER) -> dict[str, Path]:
    """The modules of cases by name."""
    return {path.stem: path for path in sorted(folder.glob("*.py")) if not path.stem.startswith(("_", "test_", "conftest"))}


def chosen(words: Sequence[str]) -> dict[str, Path]:
    """Doors by name or by path; all where none is named. Raises BrokenError."""
    known, found = doors(), {}
    for word in words:
        path = known.get(word) or (Path(word) if word.endswith(".py") else None)
        if path is None or not path.is_file():
            raise BrokenError(f"there is no door {word!r}; there are {', '.join(known)}, or give the path of a module with COUNT and case")
        found[path.stem] = path.resolve()
    return found or known


def load(path: Path) -> ModuleType:
    """A module of cases; those of tests/fuzz under the name by which they import each other."""
    if path.parent == FOLDER:
        return importlib.import_module(f"tests.fuzz.{path.stem}")
    spec = importlib.util.spec_from_file_location(f"fuzz_door_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def kept(path: Path) -> list[int]:
    """Seeds of a door that ever failed."""
    file = path.parent / "kept" / f"{path.stem}.txt"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return [int(words[0]) for line in lines if (words := line.partition("#")[0].split())]


def keep(path: Path, faults: Sequence[Fault]) -> None:
    """Add the seeds of faults to those that run first."""
    file, known = path.parent / "kept" / f"{path.stem}.txt", set(kept(path))
    file.parent.mkdir(exist_ok=True)
    with file.open("a", encoding="utf-8") as stream:
        for fault in {f.seed: f for f in faults if f.seed not in known}.values():
            stream.write(f"{fault.seed}  # {fault.what[:160]}\n")


class Worker:
    """A process that runs its share of the seeds, and is started again after the case that ended it."""

    def __init__(self, door: str, module: ModuleType, seeds: Sequence[int], root: Path, limits: Limits) -> None:
        self.door, self.module, self.seeds, self.limits, self._root, self._starts = door, module, seeds, limits, root, 0
        self.slots = memoryview(mmap(-1, 8 * SLOTS)).cast("q")
        self.faults: list[Fault] = []
        self._start()

    def _start(self) -> None:
        self._starts += 1
        self._place = self._root / str(self._starts)
        self.slots[CASES] = self.slots[BEGAN_NS] = 0
        self._began = time.monotonic()
        self._reading, writing = os.pipe()
        os.set_blocking(self._reading, False)
        self._text = b""
        sys.stdout.flush()
        self.pid = os.fork()
        if self.pid == 0:
            try:
                work(self.module.case, self.seeds, self.slots, writing, self._place, self.limits)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(99)
        os.close(writing)

    def look(self) -> bool:
        """Take in what came; whether it still runs. Kills it where a case takes too long, starts it again where one ended it."""
        self._read()
        ended, status = os.waitpid(self.pid, os.WNOHANG)
        if ended:
            self._read()
            if self.slots[DONE]:
                self._close()
                return False
            return self._after(self._how(os.waitstatus_to_exitcode(status)))
        if self._late():
            self.end()
            return self._after(f"hangs: no end after {self._limit_s():g} s")
        return True

    def end(self) -> None:
        """Kill it and what it started."""
        try:
            os.killpg(self.pid, signal.SIGKILL)
        except ProcessLookupError:  # it has not reached setsid
            os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)

    def _late(self) -> bool:
        began = self.slots[BEGAN_NS]
        return (time.monotonic_ns() - began) / 1e9 > self._limit_s() if began else time.monotonic() - self._began > self.limits.first_s and not self.slots[CASES]

    def _limit_s(self) -> float:
        return self.limits.case_s if self.slots[CASES] else self.limits.first_s

    def _after(self, what: str) -> bool:
        """The case that ended the process is a fault; go on behind it."""
        self.faults.append(Fault(self.door, self.seeds[self.slots[AT]], what))
        self._close()
        self.slots[AT] += 1
        if self.slots[AT] >= len(self.seeds):
            return False
        self._start()
        return True

    def _how(self, code: int) -> str:
        said = self._place / "said"
        lines = said.read_text(encoding="utf-8", errors="replace").strip().splitlines() if said.exists() else []
        stack = [line.strip() for line in lines if line.strip().startswith("File ") and "/scripts/fuzz" not in line]
        at = stack[0] if stack else lines[-1].strip() if lines and code else ""
        name = signal.Signals(-code).name if code < 0 else f"status {code}"
        return f"ended the process by {name}" + (f"  [{at[:160]}]" if at else "")

    def _read(self) -> None:
        try:
            while part := os.read(self._reading, 1 << 16):
                self._text += part
        except BlockingIOError:
            pass
        *lines, self._text = self._text.split(b"\n")
        self.faults += [Fault(self.door, *json.loads(line)) for line in lines]

    def _close(self) -> None:
        self._read()
        os.close(self._reading)
        shutil.rmtree(self._place, ignore_errors=True)


def run(door: str, path: Path, seeds: Sequence[int], *, jobs: int = 1, limits: Limits | None = None, bar: tqdm | None = None) -> Outcome:
    """All cases of a door; `seeds` after those that were kept."""
    outcome, began = Outcome(door), time.monotonic()
    try:
        module = load(path)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ("diffphys_ros", "tests"):
            raise
        outcome.left_out = f"there is no module {error.name}"
        return outcome
    everything = list(dict.fromkeys([*kept(path), *seeds]))
    jobs = max(1, min(jobs, len(everything)))
    with tempfile.TemporaryDirectory(prefix="fuzz-") as root:
        workers = [Worker(door, module, everything[k::jobs], Path(root).resolve() / str(k), limits or Limits()) for k in range(jobs)]
        try:
            _attend(workers, outcome, bar)
        finally:
            outcome.taken, outcome.refused = (sum(w.slots[slot] for w in workers) for slot in (TAKEN, REFUSED))
            outcome.faults = [fault for w in workers for fault in w.faults]
            outcome.seconds = time.monotonic() - began
    return outcome


def _attend(workers: Sequence[Worker], outcome: Outcome, bar: tqdm | None) -> None:
    running = list(workers)
    try:
        while running:
            running = [worker for worker in running if worker.look()]
            if bar is not None:
                bar.n = sum(w.slots[AT] for w in workers)
                bar.set_postfix_str(f"{sum(len(w.faults) for w in workers)} faults")
            if sum(len(w.faults) for w in workers) >= MOST_FAULTS:
                break
            time.sleep(POLL_S)
    finally:
        for worker in running:
            worker.end()


def seeds_of(count: int, seed: int) -> range:
    """Seeds of a run; those of two numbers do not meet."""
    return range(seed * 10_000_000, seed * 10_000_000 + count)


def outcomes(options: argparse.Namespace) -> Iterator[tuple[Path, Outcome]]:
    """Door after door."""
    for door, path in chosen(options.door).items():
        count = options.cases or math.ceil(options.share * _count(path))
        seeds = seeds_of(count, options.seed)
        with tqdm(total=count + len(kept(path)), desc=door, disable=not sys.stderr.isatty(), leave=False) as bar:
            yield path, run(door, path, seeds, jobs=options.jobs, bar=bar)


def _count(path: Path) -> int:
    """COUNT of a door as its text says it, so that a door that cannot be imported is told by `run`."""
    lines = (line.split("#")[0].split("=") for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("COUNT"))
    for words in lines:
        return int(words[1].replace("_", ""))
    raise BrokenError(f"{path} has no line 'COUNT = ...'; say how many cases a full run has")


def main(arguments: Sequence[str]) -> int:
    """All of it; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("door", nargs="*", help="doors to try, or paths of modules; all where none is named")
    parser.add_argument("--cases", type=int, default=0, help="cases per door, in place of its COUNT")
    parser.add_argument("--share", type=float, default=1.0, help="share of each door's COUNT, such as 0.01")
    parser.add_argument("--seed", type=int, default=0, help="another number gives other cases")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--keep", action="store_true", help="add the seeds of faults to tests/fuzz/kept, which run first from then on")
    parser.add_argument("--json", type=Path, help="file for the counts and faults")
    options = parser.parse_args(arguments)
    sys.path.insert(0, str(ROOT))
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    found = []
    try:
        for path, outcome in outcomes(options):
            found.append(outcome)
            print(outcome, flush=True)
            for fault in outcome.faults[:SHOWN]:
                print(f"  {fault}", flush=True)
            if options.keep and outcome.faults:
                keep(path, outcome.faults)
    except BrokenError as error:
        print(f"fuzz: {error}", file=sys.stderr)
        return 2
    if options.json:
        told = {o.door: {"taken": o.taken, "refused": o.refused, "faults": [str(f) for f in o.faults], "left_out": o.left_out} for o in found}
        options.json.write_text(json.dumps(told, indent=1), encoding="utf-8")
    faults = sum(len(outcome.faults) for outcome in found)
    print(f"{sum(o.taken + o.refused for o in found) + faults} cases, {faults} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
