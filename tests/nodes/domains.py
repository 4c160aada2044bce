"""ROS domains that no other test on this machine uses at the same time."""

from __future__ import annotations

import fcntl
import itertools
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

DOMAINS = range(1, 102)  # beyond, DDS's ports reach those that Linux hands out to others


@contextmanager
def claimed() -> Iterator[int]:
    """A domain of our own, held by a locked file until the context ends or the process dies."""
    number, file = next((n, file) for n in itertools.cycle(DOMAINS) if (file := _locked(n)))
    with file:
        yield number


def _locked(domain: int) -> IO[str] | None:
    try:
        file = (Path(tempfile.gettempdir()) / f"diffphys_ros_domain_{domain}.lock").open("w")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # another test, or another user, has it
        return None
    return file
