"""Recordings that `ros2 bag play` plays, from plain messages."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from diffphys_ros.bags.storage import METADATA, typestore
from diffphys_ros.errors import InputError

METADATA_VERSION: Literal[9] = 9  # of rosbag2 since Jazzy: quality of service by name
FOREVER = (9223372036, 854775807)  # s, ns: rosbag2's infinite duration
Message = tuple[str, str, int, Mapping[str, Any], bool]  # topic, type, time of recording [ns], fields by name, latched


def write_recording(path: str | Path, messages: Iterable[Message], *, outline: bool = False) -> Path:
    """Writes an MCAP file with profile ros2, zstd chunks, embedded message definitions and offered QoS; returns its path.

    Args:
        messages: (topic, type such as 'sensor_msgs/msg/PointCloud2', time of recording [ns], fields, latched). Fields are nested
            mappings by field name; arrays are numpy arrays, bytes or sequences; fields left out are zero or empty. A latched topic
            is offered reliable and transient local (a late subscriber gets its last message), another one reliable and volatile.
        outline: also write rosbag2's metadata.yaml beside the file, which makes the folder a bag.

    The file appears whole or not at all. Raises InputError where the place cannot be written, ValueError for an unknown field.
    """
    path = Path(path)
    try:
        scratch = Path(tempfile.mkdtemp(prefix=f".{path.stem}-", dir=path.parent))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); give a place in a writable folder") from error
    try:
        # the recording's own metadata names its file, so it has its final name from the start
        folder = scratch / path.stem
        _write_folder(folder, messages)
        if outline:
            os.replace(folder / METADATA, path.with_name(METADATA))
        os.replace(folder / f"{path.stem}.mcap", path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); free space or give a place in a writable folder") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return path


def _write_folder(folder: Path, messages: Iterable[Message]) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store, connections = typestore(), {}
    writer = Writer(folder, version=METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        for topic, kind, stamp_ns, fields, latched in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=[_qos(latched)])
            writer.write(connections[topic], stamp_ns, store.serialize_cdr(to_message(kind, fields), kind))


def to_message(kind: str, fields: Mapping[str, Any]) -> Any:
    """The message of type `kind` with these fields (see write_recording). Raises ValueError for an unknown field or type."""
    store = typestore()
    if kind not in store.fielddefs:
        raise ValueError(f"unknown message type {kind!r}")
    definitions = dict(store.fielddefs[kind][1])
    if unknown := set(fields) - set(definitions):
        raise ValueError(f"{kind} has no field {sorted(unknown)}; it has {', '.join(definitions)}")
    values = {
        name: _value(definition, fields[name]) if name in fields else _default(kind, name, definition)
        for name, definition in definitions.items()
    }
    return store.types[kind](**values)


def _value(definition: tuple[Any, Any], value: Any) -> Any:
    node, detail = definition[0].name, definition[1]
    if node == "NAME":
        return to_message(detail, value)
    if node == "BASE":
        return _scalar(detail[0], value)
    element, _length = detail
    if element[0].name == "NAME":
        return [to_message(element[1], v) for v in value]
    if element[1][0] == "string":
        return [str(v) for v in value]
    kind = _dtype(element[1][0])
    return np.frombuffer(value, kind) if isinstance(value, (bytes, bytearray, memoryview)) else np.asarray(value, kind).ravel()


def _scalar(kind: str, value: Any) -> Any:
    if kind == "string":
        return str(value)
    if isinstance(value, bytes):  # rclpy's form of a single byte
        return value[0]
    return bool(value) if kind == "bool" else (float(value) if kind.startswith("float") else int(value))


def _default(kind: str, name: str, definition: tuple[Any, Any]) -> Any:
    node, detail = definition[0].name, definition[1]
    if node == "NAME":
        return to_message(detail, {})
    if node == "ARRAY":
        element, length = detail
        return _value(
            definition, [{}] * length if element[0].name == "NAME" else [""] * length if element[1][0] == "string" else np.zeros(length)
        )
    if node == "SEQUENCE":
        return _value(definition, [])
    if kind == "geometry_msgs/msg/Quaternion" and name == "w":
        return 1.0  # as its definition says
    return _scalar(detail[0], "" if detail[0] == "string" else 0)


def _dtype(kind: str) -> np.dtype:
    return np.dtype({"bool": "?", "byte": "u1", "char": "u1"}.get(kind, kind))


def _qos(latched: bool) -> Any:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    forever = QosTime(*FOREVER)
    return Qos(
        QosHistory.KEEP_LAST,
        1 if latched else 10,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        False,
    )
