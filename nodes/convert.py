"""Plain messages of msg_schemas to rclpy messages."""

from __future__ import annotations

import importlib
from array import array
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

_CODES = {"uint8": "B", "float": "f", "double": "d"}  # of array.array, which rclpy takes over without looking at each element


def to_ros(type_name: str, fields: Mapping[str, Any]) -> Any:
    """The rclpy message of a type such as 'sensor_msgs/msg/PointCloud2'; fields left out keep their default."""
    message = message_class(type_name)()
    kinds = message.get_fields_and_field_types()
    for name, value in fields.items():
        setattr(message, name, _value(kinds[name], value))
    return message


@cache
def message_class(type_name: str) -> Any:
    """The rclpy class of 'package/msg/Name' or 'package/Name'."""
    package, *_, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def stamp_ns(message: Any) -> int:
    """Header stamp [ns]."""
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def _value(kind: str, value: Any) -> Any:
    if kind.startswith("sequence<"):
        return _sequence(kind.removeprefix("sequence<").rstrip(">").split(",")[0], value)
    if kind.endswith("]"):
        return np.asarray(value, float)
    if kind == "octet":
        return bytes([value])
    if "/" in kind:
        return to_ros(kind, value)
    return value.item() if isinstance(value, np.generic) else value


def _sequence(kind: str, value: Any) -> Any:
    if kind not in _CODES:
        return [_value(kind, item) for item in value]
    if isinstance(value, bytes):
        return array(_CODES[kind], value)
    return array(_CODES[kind], np.asarray(value).tolist())
