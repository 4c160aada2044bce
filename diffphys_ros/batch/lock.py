"""One batch at a time owns a folder; shards of the same division share it. The locks die with their process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputError

LOCK = ".batch.lock"


@contextmanager
def owned(out: Path, shard: tuple[int, int] | None) -> Iterator[None]:
    """Hold `out` while the block runs. Raises InputError where another batch holds it, or the same shard, or shards of another division."""
    with _file(out / LOCK) as whole:
        if _take(whole, fcntl.LOCK_EX):
            os.ftruncate(whole, 0)
            os.pwrite(whole, f"{shard[1] if shard else 1}\n".encode(), 0)
        if shard is None:
            if not _take(whole, fcntl.LOCK_EX):
                raise _taken(out)
            yield
            return
        if not _take(whole, fcntl.LOCK_SH) or os.pread(whole, 20, 0).split() != [str(shard[1]).encode()]:
            raise _taken(out)
        with _file(out / f".batch-{shard[0]}-of-{shard[1]}.lock") as own:
            if not _take(own, fcntl.LOCK_EX):
                raise _taken(out)
            yield


@contextmanager
def _file(path: Path) -> Iterator[int]:
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise InputError(f"output folder {path.parent}: {error.strerror or error}; choose a folder that can be written with --out") from error
    try:
        yield handle
    finally:
        os.close(handle)


def _take(handle: int, kind: int) -> bool:
    with suppress(BlockingIOError):
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
        return True
    return False


def _taken(out: Path) -> InputError:
    return InputError(f"output folder {out}: another batch is at work in it; wait for it, end it, or choose another folder with --out")
