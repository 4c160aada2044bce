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
    return sum(map(resident_mib_of, ("self", *children("self"))))


def children(pid: int | str) -> list[str]:
    """Processes that a process has started."""
    found: list[str] = []
    for listing in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):  # the thread has ended
            found += listing.read_text().split()
    return found


def give_back() -> None:
    """Return what was freed to the system, which the allocator else keeps."""
    gc.collect()
    with suppress(OSError, AttributeError):  # another C library than glibc
        ctypes.CDLL(None).malloc_trim(0)


def resident_mib_of(pid: int | str) -> float:
    """What a process holds, without its children [MiB]; 0 where it has ended."""
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_MIB
    return 0.0
