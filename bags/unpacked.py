"""Bounds on what rosbags unpacks: a recording of a few hundred kilobytes may ask for any amount of memory, disk and time.

rosbags unpacks whatever a chunk holds. Here a chunk may hold what it states, all that is open at once MOST_OPEN_BYTES, the whole
recording GROWTH times its size, and a database is not worked on for longer than its size explains.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

MOST_OPEN_BYTES = 256 << 20  # unpacked, of chunks whose times overlap: they are held at once. rosbag2 writes chunks below 1 MB
FREE_BYTES, GROWTH = 4 << 30, 50  # unpacked, of a whole recording: the first, and so many times its size on disk
FREE_STEPS, STEPS_PER_BYTE, STRIDE = 20_000_000, 100, 10_000  # of SQLite's machine for one database; how often they are counted
MOST_METADATA_BYTES = 4 << 20  # of metadata.yaml


class TooLargeError(Exception):
    """A recording unpacks to more than the bounds. The message names the bound."""


class _Pass(threading.local):
    """What one pass through a recording may still unpack [bytes]."""

    file_bytes = 0
    unpacked = 0


_pass = _Pass()


def begin_pass(file_bytes: int) -> None:
    """Before every pass through a recording of this size on disk."""
    _pass.file_bytes, _pass.unpacked = file_bytes, 0


def _take(size: int) -> None:
    _pass.unpacked += size
    if _pass.unpacked > FREE_BYTES + GROWTH * _pass.file_bytes:
        raise TooLargeError(f"{_pass.file_bytes} bytes unpack to more than {FREE_BYTES >> 30} GiB and {GROWTH} times that, no more are read")


class Unread(list[Any]):
    """Qualities of service as a recording tells them: no list yet, so that two of a topic are equal whoever wrote them."""

    def __init__(self, told: Any) -> None:
        super().__init__()
        self.told = told


@cache
def bound_rosbags() -> None:
    """Puts the bounds into rosbags, once. Qualities of service, YAML inside YAML, are kept as they are written (`Unread`)."""
    from rosbags.rosbag2 import reader, storage_mcap, storage_sqlite3

    def unzstd(data: bytes, size: int) -> bytes:
        return _unpacked(data, size, storage_mcap.zstd.ZstdDecompressor)

    def unlz4(data: bytes, size: int) -> bytes:
        from lz4.frame import LZ4FrameDecompressor

        return _unpacked(data, size, LZ4FrameDecompressor)

    storage_mcap.DECOMPRESSORS.update(zstd=unzstd, lz4=unlz4)
    message_wise = SimpleNamespace(open=_open_zstd, decompress=lambda data: _unpacked(data, MOST_OPEN_BYTES, storage_mcap.zstd.ZstdDecompressor))
    reader.zstd = message_wise  # type: ignore[attr-defined,assignment]
    for module in (reader, storage_mcap, storage_sqlite3):
        module.parse_qos = Unread  # type: ignore[attr-defined]


def check_chunks(chunks: list[Any], file_bytes: int) -> None:
    """Of the chunks of an MCAP file, by its index: each lies in the file, none is named twice, and what is open at
    once keeps the bound."""
    ranges = sorted((c.chunk_start_offset, c.chunk_start_offset + c.chunk_length) for c in chunks)
    if any(end > file_bytes or end <= start for start, end in ranges) or any(b[0] < a[1] for a, b in pairwise(ranges)):
        raise TooLargeError("its index names chunks that overlap or lie outside of the file")
    sizes = [max(c.uncompressed_size, c.compressed_size) for c in chunks]
    # a chunk is opened at its first time and let go at its last; what opens at a time comes before what ends there
    events = sorted(
        event
        for c, size in zip(chunks, sizes, strict=True)
        for event in ((c.message_start_time, 0, size), (max(c.message_start_time, c.message_end_time), 1, -size))
    )
    held = most = 0
    for _, _, change in events:
        held += change
        most = max(most, held)
    _check_open(most)


def check_metadata(path: Path) -> None:
    """That metadata.yaml is small and without aliases, whose few characters may stand for any length."""
    import yaml

    if path.stat().st_size > MOST_METADATA_BYTES:
        raise TooLargeError(f"metadata.yaml has {path.stat().st_size} bytes, at most {MOST_METADATA_BYTES} are read")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(path.read_text(encoding="utf-8"), Loader=loader)):
        raise TooLargeError("metadata.yaml holds aliases, rosbag2 writes none")


@contextmanager
def bounded_databases() -> Iterator[None]:
    """While it lasts, SQLite databases that are opened end their work where it goes beyond the bound."""
    import apsw

    def hook(connection: Any) -> None:
        left = (FREE_STEPS + STEPS_PER_BYTE * Path(connection.filename).stat().st_size) // STRIDE

        def spent() -> bool:
            nonlocal left
            left -= 1
            return left < 0

        connection.set_progress_handler(spent, STRIDE)
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, MOST_OPEN_BYTES)

    apsw.connection_hooks.append(hook)
    try:
        yield
    finally:
        apsw.connection_hooks.remove(hook)


def _check_open(size: int) -> None:
    if size > MOST_OPEN_BYTES:
        raise TooLargeError(f"chunks of {size} bytes are open at once, at most {MOST_OPEN_BYTES} may be; record with smaller chunks")


def _unpacked(data: bytes, size: int, decompressor: Callable[[], Any]) -> bytes:
    """At most `size` bytes of one or more frames."""
    _check_open(size)
    parts, left = [], size
    while data:
        machine = decompressor()
        parts.append(machine.decompress(data, left + 1))
        left -= len(parts[-1])
        if left < 0:
            raise TooLargeError(f"compressed data unpacks to more than the {size} bytes that may be")
        if not machine.eof:
            raise EOFError("compressed data ends too soon")
        data = machine.unused_data
    _take(size - left)
    return b"".join(parts)


def _open_zstd(file: Any, mode: Any) -> Any:
    from rosbags.rosbag2.storage_mcap import zstd

    return _Counted(zstd.open(file, mode))


class _Counted:
    """A file that is unpacked as it is read, up to the bound."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        piece = self._file.read(size)
        _take(len(piece))
        return bytes(piece)

    def __enter__(self) -> _Counted:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
