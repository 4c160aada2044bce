"""One hostile case after the other, inside a process that may be killed: limits, a scratch folder, and what is watched around each case."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import json
import os
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
OUTCOMES = ("taken", "refused")
AT, BEGAN_NS, TAKEN, REFUSED, DONE, CASES = range(6)  # slots of a worker in the shared memory
SLOTS = 6
WRITES = {"os.mkdir": 0, "os.rename": 1, "os.remove": 0, "os.rmdir": 0, "os.link": 1, "os.symlink": 1, "os.truncate": 0}  # audit events: argument that names what is changed
LONGEST = 300  # characters of a told exception

Case = Callable[[int, Path], str]


@dataclass(frozen=True)
class Limits:
    """What one case may take."""

    case_s: float = 10.0  # wall time
    first_s: float = 60.0  # of a worker's first case, which imports and builds what the others change
    growth: int = 1 << 30  # bytes of resident memory, at the peak of a case or left behind by many
    room: int = 3 << 30  # bytes of address space above what imports take
    room_without_torch: int = 3 << 29
    file: int = 4 << 30  # bytes of the largest file


class FaultError(Exception):
    """What a case did beside its answer: files, warnings, memory."""


class Place:
    """A worker's folders: what a case may write is `case`, whatever appears in the others it should not have written."""

    def __init__(self, root: Path) -> None:
        self.root, self.case = root, root / "case"
        self.watched = [root / name for name in ("home", "cwd", "tmp")]
        self.caches = root / "caches"  # of third parties, which may write when they like
        for folder in (self.case, self.caches, *self.watched):
            folder.mkdir(parents=True)
        self.known = set(os.listdir(root)) | {"said"}

    def enter(self) -> None:
        """Make these folders the process's own."""
        home, cwd, tmp = map(str, self.watched)
        os.environ |= {"HOME": home, "TMPDIR": tmp, "XDG_CACHE_HOME": f"{home}/.cache", "ROS_LOG_DIR": str(self.caches)}
        os.environ |= {name: str(self.caches) for name in ("MPLCONFIGDIR", "WARP_CACHE_PATH", "TORCH_HOME", "HF_HOME")}
        tempfile.tempdir = None
        os.chdir(cwd)

    def strays(self) -> list[str]:
        """Files outside the scratch folder; they are removed. Empties the scratch folder."""
        found = [self.root / name for name in set(os.listdir(self.root)) - self.known]
        found += [folder / name for folder in self.watched for name in os.listdir(folder)]
        for path in found:
            _remove(path)
        if not self.case.is_dir() or os.listdir(self.case):
            _remove(self.case)
            self.case.mkdir()
        return sorted(str(path.relative_to(self.root)) for path in found)


class Watch:
    """Notes warnings of our own code, and writing outside the worker's folders where Python's own calls do it."""

    def __init__(self, place: Place) -> None:
        self._root, self.noted = str(place.root), []
        sys.dont_write_bytecode = True
        warnings.simplefilter("always", RuntimeWarning)
        warnings.showwarning = self._warned
        sys.addaudithook(self._audited)

    def _warned(self, message: Any, category: type[Warning], *_: Any, **__: Any) -> None:
        if issubclass(category, RuntimeWarning) and (where := _ours()):
            self.noted.append(f"{category.__name__}: {message} ({where})")

    def _audited(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = args
            if not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                return
        elif event in WRITES:
            path = args[WRITES[event]]
        else:
            return
        if not isinstance(path, (str, bytes)):
            return
        full = os.path.abspath(os.fsdecode(path))  # links are followed by nobody but the case's own doing
        if not full.startswith((self._root, "/dev/", "/proc/self/")):
            self.noted.append(f"{event} of {full[:120]!r} outside the scratch folder")


def _ours() -> str:
    """Where in our code the innermost frame of it stands; empty where the fuzz modules themselves are at fault."""
    frame = sys._getframe(2)
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(ROOT) and "site-packages" not in path.parts:
            relative = path.relative_to(ROOT)
            return "" if relative.parts[0] in ("tests", "scripts") else f"{relative}:{frame.f_lineno}"
        frame = frame.f_back
    return ""


def work(case: Case, seeds: Sequence[int], slots: memoryview, faults: int, root: Path, limits: Limits) -> None:
    """Run cases from `slots[AT]` on, write counts into `slots` and faults as JSON lines into the descriptor `faults`. Never returns."""
    os.setsid()
    place = Place(root)
    _quiet(root / "said")
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limits.file, limits.file))
    place.enter()
    gc.freeze()  # what the parent left, garbage too, is no case's to free
    watch, memory = Watch(place), Memory(limits)
    while slots[AT] < len(seeds):
        seed = seeds[slots[AT]]
        slots[BEGAN_NS] = time.monotonic_ns()
        try:
            slots[TAKEN if _tried(case, seed, place, watch, memory) == OUTCOMES[0] else REFUSED] += 1
        except BaseException as error:  # whatever it is, it is what the fuzzer looks for
            os.write(faults, (json.dumps([seed, _told(error)]) + "\n").encode())
        slots[BEGAN_NS], slots[CASES] = 0, slots[CASES] + 1
        slots[AT] += 1
    slots[DONE] = 1
    os._exit(0)


def _tried(case: Case, seed: int, place: Place, watch: Watch, memory: Memory) -> str:
    watch.noted.clear()
    memory.begin()
    try:
        outcome = case(seed, place.case)
    finally:
        os.chdir(place.watched[1])
        memory.end()
        strays = place.strays()
    if outcome not in OUTCOMES:
        raise FaultError(f"answered {outcome!r:.80}, neither {' nor '.join(OUTCOMES)}")
    if strays:
        raise FaultError(f"made {', '.join(strays)[:200]} outside its folder")
    if watch.noted:
        raise FaultError(watch.noted[0])
    memory.check()
    return outcome


class Memory:
    """Resident memory of this process, and its limit of address space."""

    def __init__(self, limits: Limits) -> None:
        self._limits, self._modules, self._first, self._before, self._peak, self._own = limits, -1, 0, 0, 0, 0

    def begin(self) -> None:
        if len(sys.modules) != self._modules:  # libraries that came late are no case's doing
            self._modules = len(sys.modules)
            room = self._limits.room if "torch" in sys.modules else self._limits.room_without_torch
            hard = resource.getrlimit(resource.RLIMIT_AS)[1]
            resource.setrlimit(resource.RLIMIT_AS, (_status()["VmSize"] + room, hard))
            self._first = 0
        with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w") as file:
            file.write("5")  # the peak starts anew
        status = _status()
        self._before = status["VmRSS"]
        self._first = self._first or _own(status)

    def end(self) -> None:
        status = _status()
        self._peak, self._own = status["VmHWM"], _own(status)

    def check(self) -> None:
        """Raises FaultError where this case, or all together, took too much."""
        for grown, what in ((self._peak - self._before, "at its peak, in one case"), (self._own - self._first, "over the cases so far, kept")):
            if grown > self._limits.growth:
                self._first = self._own
                raise FaultError(f"memory grew by {grown / 2**20:.0f} MB {what}; the bound is {self._limits.growth / 2**20:.0f} MB")


def _status() -> dict[str, int]:
    """Sizes of this process in bytes."""
    with open("/proc/self/status") as file:
        pairs = (line.split() for line in file if line.startswith(("Vm", "Rss")))
        return {words[0][:-1]: int(words[1]) * 1024 for words in pairs}


def _own(status: dict[str, int]) -> int:
    """Bytes that no file can give back; pages of libraries come and go with the memory that the machine has left."""
    return status.get("RssAnon", status["VmRSS"]) + status.get("RssShmem", 0) + status.get("VmSwap", 0)


def _told(error: BaseException) -> str:
    """Kind, message and the innermost lines of our own code of an exception, shortened."""
    stack = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in stack if Path(frame.filename).is_relative_to(ROOT) and "site-packages" not in frame.filename]
    at = [f"{Path(f.filename).relative_to(ROOT)}:{f.lineno} {f.line}" for f in ours if Path(f.filename) != Path(__file__)][-1:]
    at = at or [f"{Path(f.filename).name}:{f.lineno} {f.line}" for f in stack if Path(f.filename) != Path(__file__)][-1:]
    text = str(error) if isinstance(error, FaultError) else f"{type(error).__name__}: {error}"
    where = "" if isinstance(error, FaultError) or not at else f"  [{at[0][:160]}]"
    return " ".join(text.split())[:LONGEST].encode("utf-8", "backslashreplace").decode() + where


def _quiet(path: Path) -> None:
    """What is printed goes into a file, and a crash's stack too."""
    said = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for source, target in ((nothing, 0), (said, 1), (said, 2)):
        os.dup2(source, target)
    faulthandler.enable(2, all_threads=False)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        path.chmod(0o700)
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
