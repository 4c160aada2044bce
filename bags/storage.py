"""The door to recordings: MCAP files, rosbag2 folders and .db3 files as topics and messages."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from diffphys_ros.bags.offers import Offer, offer_of
from diffphys_ros.bags.unpacked import begin_pass, bound_rosbags, bounded_databases, check_chunks, check_metadata
from diffphys_ros.errors import InputError, listed, named, shown

BAG_SUFFIXES = (".mcap", ".db3")
METADATA = "metadata.yaml"  # of a rosbag2 folder
MOST_REASON = 160  # characters of what a parser says


@cache
def typestore() -> Any:
    """The message types of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def read_message(kind: str, raw: bytes) -> Any:
    """The message of a type in CDR."""
    return typestore().deserialize_cdr(raw, kind)


class Bag:
    """An open recording; `types` maps every topic that announces messages of one type to that type, `mixed` the others to theirs."""

    def __init__(self, path: Path, reader: Any) -> None:
        self._path, self._reader, self._bytes = path, reader, _size(path)
        found = defaultdict(set)
        for connection in reader.connections:
            if connection.msgcount:
                found[str(connection.topic)].add(str(connection.msgtype))
        self.types = {topic: kinds.pop() for topic, kinds in found.items() if len(kinds) == 1}
        self.mixed = {topic: kinds for topic, kinds in found.items() if len(kinds) > 1}

    @property
    def span(self) -> tuple[int, int]:
        """Log times [ns] of the first message and after the last one; equal where there is none."""
        return (self._reader.start_time, self._reader.end_time) if self._reader.message_count else (0, 0)

    def offer(self, topic: str) -> Offer:
        """The quality of service with which a topic was recorded."""
        return offer_of(topic, [c.ext.offered_qos_profiles for c in self._reader.connections if c.topic == topic])

    def messages(self, topics: Collection[str], begin_ns: int | None = None, end_ns: int | None = None) -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics in the order of the recording; see `raw`."""
        for topic, log_ns, raw in self.raw(topics, begin_ns, end_ns):
            with _readable(self._path):
                message = read_message(self.types[topic], raw)
            yield topic, log_ns, message

    def raw(self, topics: Collection[str], begin_ns: int | None = None, end_ns: int | None = None) -> Iterator[tuple[str, int, bytes]]:
        """(topic, log time [ns], CDR) of some topics in the order of the recording, from one log time to before another. Holds what
        lies in one chunk, however large the recording is. Raises InputError where it is damaged, and for a topic of two types."""
        for topic in self.mixed.keys() & set(topics):
            raise InputError(
                f"{shown(self._path)}: topic {named(topic)} holds messages of {len(self.mixed[topic])} types ({listed(sorted(self.mixed[topic]), 3)}), "
                "must hold one; record it again with a name for each"
            )
        begin_pass(self._bytes)
        chosen = [c for c in self._reader.connections if c.topic in topics]
        if chosen:
            with _readable(self._path):
                for connection, log_ns, raw in self._reader.messages(chosen, begin_ns, end_ns):
                    yield connection.topic, log_ns, bytes(raw)

    def first(self, topic: str) -> Any | None:
        """First message of a topic; None where there is none, whatever the recording announces (it was filtered, or broke off)."""
        return next((message for _, _, message in self.messages([topic])), None)


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Opens an .mcap or .db3 file or a rosbag2 folder (metadata.yaml). Raises InputError where it is none or damaged."""
    from rosbags.rosbag2 import Reader

    bound_rosbags()
    with bounded_databases():
        with _readable(path):
            _check_files(path)
            begin_pass(_size(path))
            reader = Reader(path)
            reader.open()
        try:
            with _readable(path):
                for storage in getattr(reader.storage, "storages", [reader.storage]):
                    check_chunks(getattr(storage, "chunks", []), storage.path.stat().st_size)
                bag = Bag(path, reader)
            yield bag
        finally:
            reader.close()


def existing(path: str | Path) -> Path:
    """The path of a regular file or a folder. Raises InputError where there is none: a pipe or a device may never end."""
    path = Path(path)
    try:
        found, there = path.is_file() or path.is_dir(), path.exists()
    except (OSError, ValueError):  # a name too long, or with a NUL
        found = there = False
    if found:
        return path
    if there:
        raise InputError(f"{shown(path)}: is neither a regular file nor a folder; give the path of a bag, a video or a folder of images")
    raise InputError(f"{shown(path)}: there is no such file or folder; give the path of a bag, a video or a folder of images")


def _size(path: Path) -> int:
    """Of a recording on disk [bytes]."""
    return sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else [path]))


def _check_files(path: Path) -> None:
    if not path.is_dir():
        return
    if odd := [file.name for file in path.iterdir() if not (file.is_file() or file.is_dir())]:
        raise InputError(f"{shown(path)}: {listed(odd, 3)} is no regular file; remove it from the recording's folder")
    check_metadata(path / METADATA)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:  # a damaged file can fail anywhere below: in the container, the compression or the messages
        reason = named(" ".join(str(error)[:1000].split()).rstrip("."), MOST_REASON) or type(error).__name__
        raise InputError(
            f"{shown(path)}: not a complete ROS 2 recording ({reason}); record it again, or mend it with 'mcap recover' or 'ros2 bag reindex'"
        ) from error
