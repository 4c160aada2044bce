"""How much memory a node and its solver hold, and how it is given back."""

from __future__ import annotations

import ctypes
import gc
import os
import threading
import time
from contextlib import suppress
from pathlib import Path

FREED_MIB, LOOK_S = 64.0, 2.0  # growth from which, and how often, it is looked whether what was freed is still held
_PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def held_mib(pid: int | str = "self") -> float:
    """What a process and its children hold now, what they share counted once and their share of what others map too [MiB]; 0 where it has ended."""
    return sum(map(held_mib_of, (pid, *children(pid))))


def held_mib_of(pid: int | str) -> float:
    """Proportional set size of a process alone [MiB]; 0 where it has ended. Slower than `resident_mib_of`: the kernel looks at every page."""
    with suppress(OSError):
        rows = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        return next((int(row.split()[1]) / 1024 for row in rows if row.startswith("Pss:")), 0.0)
    return 0.0


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


def give_back_always() -> None:
    """From here on whatever the work does: it leaves small pieces between large ones, and the allocator keeps the holes, up to what the work needs
    once more."""
    threading.Thread(target=_give_back_for_ever, name="memory", daemon=True).start()


def _give_back_for_ever() -> None:
    trim, least = getattr(ctypes.CDLL(None), "malloc_trim", None), resident_mib_of("self")
    while trim is not None:  # glibc alone has it
        time.sleep(LOOK_S)
        least = min(least, now := resident_mib_of("self"))
        if now - least > FREED_MIB:
            trim(0)
            least = resident_mib_of("self")


def resident_mib_of(pid: int | str) -> float:
    """What a process maps, without its children, pages of others among it [MiB]; 0 where it has ended."""
    with suppress(OSError):
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_MIB
    return 0.0
