"""One child process in a session of its own, with its output in a file."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PACKAGE_ROOT = Path(__file__).resolve().parent.parent.parent
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMEXPR_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")


@dataclass(frozen=True)
class Ended:
    """How a process ended."""

    exit: int  # status; below 0: the signal
    processor_s: float
    memory_mb: float  # largest resident size


class Process:
    """`diffphys WORDS...`, its output appended to `log`. Whoever makes it polls it."""

    def __init__(self, words: Sequence[str], log: Path, *, cwd: str, device: str, environment: Mapping[str, str]):
        read, write = os.pipe()
        try:
            with log.open("ab") as file:
                self._child = subprocess.Popen(
                    [sys.executable, "-P", "-m", "diffphys_ros.batch.child", str(os.getpid()), str(write), device, *words],
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    cwd=cwd,
                    env=_environment(environment),
                    pass_fds=(write,),
                    start_new_session=True,
                )
        except BaseException:
            os.close(read)
            raise
        finally:
            os.close(write)
        self._report = read
        self._said: dict[str, Any] | None = None
        self.pid = self._child.pid
        self.ended: Ended | None = None

    def poll(self) -> Ended | None:
        """How it ended, or None while it runs."""
        if self.ended is None:
            pid, status, used = os.wait4(self.pid, os.WNOHANG)
            if pid:
                self.ended = Ended(os.waitstatus_to_exitcode(status), used.ru_utime + used.ru_stime, used.ru_maxrss / 1000)
                self._child.returncode = self.ended.exit  # it was waited for here
                self._signal(signal.SIGKILL)  # what it may have begun ends with it
        return self.ended

    def ask(self) -> None:
        """Ask it to end; it leaves its checkpoint and whole files."""
        if self.ended is None:
            self._signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it and whatever it began."""
        if self.ended is None:
            self._signal(signal.SIGKILL)

    def report(self) -> dict[str, Any]:
        """What it said of itself before it began: device and versions; empty where it died before. To be asked after it has ended."""
        if self._said is None:
            self._said = {}  # read once, whatever interrupts that
            with os.fdopen(self._report, "rb") as file:
                os.set_blocking(self._report, False)
                text = file.read() or b""
            with suppress(ValueError):
                self._said = dict(json.loads(text))
        return self._said

    def _signal(self, number: int) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, number)


def _environment(more: Mapping[str, str]) -> dict[str, str]:
    known = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(PACKAGE_ROOT), *([known] if known else [])])
    return {**os.environ, **ONE_THREAD, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", **more}
