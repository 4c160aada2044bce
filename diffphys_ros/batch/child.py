"""What a clip's process runs first: it ties its life to the process that began it, says what it computes on, and is `diffphys` from then on.

python -m diffphys_ros.batch.child PARENT_PID REPORT_FD DEVICE WORDS...
"""

from __future__ import annotations

import ctypes
import faulthandler
import json
import os
import runpy
import signal
import sys

from .machine import device_name, versions

PR_SET_PDEATHSIG = 1


def main(arguments: list[str]) -> None:
    """Never returns normally: ends as `diffphys WORDS...` does."""
    parent, report, device, *words = arguments
    _die_with(int(parent))
    faulthandler.enable()  # a segmentation fault leaves its trace in the log
    with os.fdopen(int(report), "w") as file:
        json.dump({"device": device_name(device), "versions": versions()}, file)
    sys.argv = ["diffphys", *words]
    runpy.run_module("diffphys_ros", run_name="__main__", alter_sys=True)


def _die_with(parent: int) -> None:
    """A batch or a Ray worker that is killed must leave no process that still writes where the next attempt will."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


if __name__ == "__main__":
    main(sys.argv[1:])
