"""How much memory a node and its solver hold, and how it is given back."""

from __future__ import annotations

import ctypes
import gc
import os
from contextlib import suppress
from pathlib import Path

_PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def resident_mib() -> float:
    """What this process and its children hold now [MiB]."""
    pids = ["self"]
    for listing in Path("/proc/self/task").glob("*/children"):
        with suppress(OSError):  # the thread has ended
            pids += listing.read_text().split()
    return sum(map(_resident_mib, pids))


def give_back() -> None:
    """Return what was freed to the system, which the allocator else keeps."""
    gc.collect()
    with suppress(OSError, AttributeError):  # another C library than glibc
        ctypes.CDLL(None).malloc_trim(0)


def _resident_mib(pid: str) -> float:
    with suppress(OSError):  # it has ended
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_MIB
    return 0.0
