"""One setting: what it may be, and the check of a value."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from ..errors import InputError, short
from .tree import Settings

LONGEST_TEXT, LONGEST_PATH = 512, 4096  # characters
LONGEST_LIST = 254  # values: label images know no more parts
BROKEN = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]")  # control characters and halves of surrogate pairs: no path, topic or name has them


@dataclass(frozen=True)
class Leaf:
    """One setting: everything that a command line, a parameter description or a table needs."""

    name: str  # dotted
    kind: type  # bool, int, float or str: of the value, or of the elements of a list
    is_list: bool
    optional: bool  # whether null is allowed
    default: Any
    doc: str
    unit: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    length: int | None
    path: bool
    pattern: str
    heading: str  # who needs it, one of tree.HEADINGS

    @property
    def range_text(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return ", ".join(self.choices)
        low, high = (("" if v is None else f"{v:g}") for v in (self.low, self.high))
        return f"{low} .. {high}" if low or high else ""

    @property
    def example(self) -> str:
        """A value as a command line has it."""
        if self.kind is str:
            return self.choices[-1] if self.choices else "NAME" if not self.path else "PATH"
        one = "true" if self.kind is bool else f"{1.0 if self.low is None else min(max(self.low, 1.0), self.high or 1.0):g}"
        return ",".join([one] * (self.length or 1))

    def checked(self, value: Any, origin: str) -> Any:
        """The value in the setting's own type. Raises InputError that names origin, setting, bound and cure."""
        if self._left_out(value):
            if not self.optional:
                raise InputError(f"{origin}: {self.name} must not be null; leave it out for its default {self.default}")
            return None
        if not self.is_list:
            return self._scalar(value, origin)
        items = self._unpaired(list(value)) if isinstance(value, (list, tuple)) else [value]
        if self.length and len(items) != self.length:
            raise InputError(f"{origin}: {self.name} has {len(items)} numbers, needs {self.length}; give {self.doc}")
        if not 1 <= len(items) <= LONGEST_LIST:
            raise InputError(f"{origin}: {self.name} has {len(items)} values, must have 1 to {LONGEST_LIST}; give {self.doc}")
        return [self._scalar(item, origin) for item in items]

    def _unpaired(self, items: list[Any]) -> list[Any]:
        """The numbers u v u v of points that are written as [[u, v], [u, v]]; other lists as they are."""
        pairs = self.unit == "px" and all(isinstance(item, (list, tuple)) and len(item) == 2 for item in items)
        return [number for pair in items for number in pair] if pairs else items

    def _left_out(self, value: Any) -> bool:
        """Whether a value stands for none; `==` alone would compare an array element by element."""
        empty = (isinstance(value, list) and self.is_list) or (isinstance(value, str) and self.kind is str and not self.is_list)
        return value is None or (self.optional and empty and len(value) == 0)

    def _scalar(self, value: Any, origin: str) -> Any:
        need = self._text_need(value) if self.kind is str else self._bool_need(value) if self.kind is bool else self._number_need(value)
        if need:
            raise InputError(f"{origin}: {self.name} is {short(value)}, must be {need}")
        return os.path.expanduser(value) if self.path else self.kind(value)

    def _text_need(self, value: Any) -> str:
        """What a value would have to be; empty where it is that already."""
        longest = LONGEST_PATH if self.path else LONGEST_TEXT
        if not isinstance(value, str):
            return "text; put it between quotes"
        if len(value) > longest:
            return f"text of at most {longest} characters"
        if BROKEN.search(value):
            return "text without control characters and broken Unicode"
        if self.choices and value not in self.choices:
            return "one of " + ", ".join(self.choices)
        return self.doc if self.pattern and not re.fullmatch(self.pattern, value) else ""

    def _bool_need(self, value: Any) -> str:
        return "" if isinstance(value, bool) else "true or false"

    def _number_need(self, value: Any) -> str:
        of_unit = f" {self.unit}" if self.unit else ""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return "a number" + (f" in {self.unit}" if self.unit else "") + ", written like 2, 0.8 or 1e-3"
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            return "finite" + (f", in {self.range_text}{of_unit}" if self.range_text else "")
        if (self.low is not None and value < self.low) or (self.high is not None and value > self.high):
            return f"in {self.range_text}{of_unit}"
        return "a whole number" if self.kind is int and value != int(value) else ""


@cache
def leaves() -> Mapping[str, Leaf]:
    """All settings by dotted name, in the order of the tree."""
    found = {}
    for group in dataclasses.fields(Settings):
        cls = group.default_factory  # type: ignore[misc]
        hints = typing.get_type_hints(cls)
        for f in dataclasses.fields(cls):  # type: ignore[arg-type]
            kind, is_list, optional = _kind(hints[f.name])
            default = f.default if f.default is not dataclasses.MISSING else f.default_factory()  # type: ignore[misc,operator]
            found[f"{group.name}.{f.name}"] = Leaf(f"{group.name}.{f.name}", kind, is_list, optional, default, **f.metadata, heading=group.metadata["heading"])
    return types.MappingProxyType(found)


def _kind(hint: Any) -> tuple[type, bool, bool]:
    optional = isinstance(hint, types.UnionType) and type(None) in hint.__args__
    if optional:
        hint = next(a for a in hint.__args__ if a is not type(None))
    if typing.get_origin(hint) is list:
        return hint.__args__[0], True, optional
    return hint, False, optional
