"""Real processes in a ROS domain of their own, for the tests of the nodes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import diffphys_ros
from diffphys_ros.nodes.middleware import PROFILE, VARIABLE

from .domains import claimed

ROOT = Path(diffphys_ros.__file__).resolve().parent.parent
PATIENCE_S = 120.0  # for what takes seconds, on however busy a machine; then something hangs
FIT_S = 400.0  # for a fit, with every kernel compiled for the first time


def environment(domain: int) -> dict[str, str]:
    """The whole environment, with this checkout first and nothing heard from outside."""
    own = {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_PYTHON_CHECK_FIELDS": "1",
        VARIABLE: str(PROFILE),
        "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "PYTHONUNBUFFERED": "1",
        "OMP_NUM_THREADS": "2",  # equal bits must not hang on a single thread
        "OMP_WAIT_POLICY": "passive",  # the second thread must not spin while the machine is busy
        "OPENBLAS_NUM_THREADS": "1",  # whose threads spin whatever that says; torch's are those that could change bits
    }
    return os.environ | own


class Domain:
    """Processes that hear each other alone; each writes NAME.log into `folder`. Use it as a context."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment: dict[str, str] = {}
        self.running: dict[str, subprocess.Popen] = {}
        self._claim = ExitStack()

    def __enter__(self) -> Domain:
        self.environment = environment(self._claim.enter_context(claimed()))
        return self

    def __exit__(self, *error: object) -> None:
        with self._claim:
            self.kill()

    def kill(self) -> None:
        """Ends what still runs."""
        for process in self.running.values():
            if process.poll() is None:
                process.kill()
                process.wait()

    def node(self, executable: str, *, name: str = "", **parameters: object) -> subprocess.Popen:
        """Start a node's executable, its log called `name`; `__` in a parameter's name stands for a dot."""
        words = [w for key, value in parameters.items() for w in ("-p", f"{key.replace('__', '.')}:={value}")]
        code = f"from diffphys_ros.nodes.executables import {executable}; {executable}()"
        return self.start(name or executable, "-c", code, "--ros-args", *words)

    def start(self, name: str, *arguments: str) -> subprocess.Popen:
        """Start Python with these arguments; asked with SIGABRT it writes where it stands."""
        with self._log(name).open("w") as log:
            self.running[name] = subprocess.Popen([sys.executable, "-X", "faulthandler", *arguments], stdout=log, stderr=subprocess.STDOUT, env=self.environment)
        return self.running[name]

    def said(self, name: str) -> str:
        """What a process has written."""
        return self._log(name).read_text(errors="replace")

    def await_words(self, name: str, words: str, timeout_s: float = PATIENCE_S) -> None:
        """Wait until a process has written these words; fails with its log where it ends before or takes longer."""
        until = time.monotonic() + timeout_s
        while words not in self.said(name):
            assert self.running[name].poll() is None, f"{name} ended with status {self.running[name].returncode}:\n{self.said(name)}"
            assert time.monotonic() < until, f"{name} has not said {words!r} in {timeout_s} s:\n{self.said(name)}"
            time.sleep(0.05)

    def end(self, name: str, *signals: signal.Signals, gap_s: float = 0.0) -> int:
        """Send signals to a process; its exit status."""
        process = self.running[name]
        for number in signals:
            process.send_signal(number)
            time.sleep(gap_s)
        return self.ended(name)

    def end_all(self) -> dict[str, int]:
        """SIGINT to every process; the exit statuses."""
        for process in self.running.values():
            process.send_signal(signal.SIGINT)
        return {name: self.ended(name) for name in self.running}

    def ended(self, name: str) -> int:
        """Wait until a process has ended; its exit status."""
        process = self.running[name]
        try:
            return process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGABRT)  # has it write where it stands
            process.wait(PATIENCE_S)
            raise AssertionError(f"{name} did not end within {PATIENCE_S} s:\n{self.said(name)}") from None

    def _log(self, name: str) -> Path:
        return self.folder / f"{name}.log"
