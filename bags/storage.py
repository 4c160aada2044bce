"""The door to recordings: MCAP files, rosbag2 folders and .db3 files as topics and messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from diffphys_ros.errors import InputError


@cache
def typestore() -> Any:
    """The message types of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


class Bag:
    """An open recording; `types` maps every topic with messages to its message type."""

    def __init__(self, path: Path, reader: Any) -> None:
        self._path, self._reader = path, reader
        self.types = {c.topic: c.msgtype for c in reader.connections if c.msgcount}

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """(topic, log time [ns], message) of some topics in the order of the recording. Raises InputError where it is damaged."""
        chosen = [c for c in self._reader.connections if c.topic in topics]
        if chosen:
            with _readable(self._path):
                for connection, log_ns, raw in self._reader.messages(chosen):
                    yield connection.topic, log_ns, typestore().deserialize_cdr(raw, connection.msgtype)

    def first(self, topic: str) -> Any:
        """First message of a topic that has one."""
        return next(self.messages([topic]))[2]


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Opens an .mcap or .db3 file or a rosbag2 folder (metadata.yaml). Raises InputError where it is none or damaged."""
    from rosbags.rosbag2 import Reader

    with _readable(path):
        reader = Reader(path)
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:  # a damaged file can fail anywhere below: in the container, the compression or the messages
        reason = " ".join(str(error).split()).rstrip(".")[:160] or type(error).__name__
        raise InputError(
            f"{path}: not a complete ROS 2 recording ({reason}); record it again, or mend it with 'mcap recover' or 'ros2 bag reindex'"
        ) from error
