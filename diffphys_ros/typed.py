"""Dataclasses built from values of unknown origin: every field is held to its annotation."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any

LARGEST = 2**63  # whole numbers lie below


def fitting(cls: Any, values: Mapping[str, Any]) -> Any:
    """cls(**values). Raises TypeError where `cls` is no dataclass, or a field is missing, unknown or of another type."""
    kinds = kinds_of(cls)
    built = cls(**values)
    wrong = [name for name, kind in kinds.items() if not _is(getattr(built, name), kind)]
    if wrong:
        raise TypeError(f"{cls.__name__}.{wrong[0]} is of another type")
    return built


@cache
def kinds_of(cls: Any) -> dict[str, Any]:
    """Annotations by field, of a generic class X[Y] with Y in its place. Raises TypeError where `cls` is no dataclass."""
    base = typing.get_origin(cls) or cls
    hints, given = typing.get_type_hints(base), dict(zip(getattr(base, "__parameters__", ()), typing.get_args(cls), strict=False))
    return {field.name: given.get(hints[field.name], hints[field.name]) for field in dataclasses.fields(base)}


def _is(value: Any, kind: Any) -> bool:
    """Whether a value is what an annotation says: a class or generic X[Y], None, Any, X | Y, tuple[X, ...], list[X], dict[X, Y]."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return True
    if origin in (types.UnionType, typing.Union):
        return any(_is(value, one) for one in arguments)
    if origin is dict:
        return isinstance(value, dict) and all(_is(k, arguments[0]) and _is(v, arguments[1]) for k, v in value.items())
    if origin is tuple and Ellipsis not in arguments:
        return isinstance(value, tuple) and len(value) == len(arguments) and all(map(_is, value, arguments))
    if origin in (tuple, list):
        return isinstance(value, origin) and all(_is(item, arguments[0]) for item in value)
    if kind in (int, float) and isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < LARGEST
    return isinstance(value, origin or kind)
