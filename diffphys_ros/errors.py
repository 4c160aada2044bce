"""Errors that a user can act on, and how a message shows what was given."""

from __future__ import annotations

import reprlib
from collections.abc import Iterable
from typing import Any

SHORT = 80  # characters of a value in a message
LONGEST_PATH = 200  # characters of a path in a message


class InputError(ValueError):
    """Bad input. The message is one sentence that names the input, the bound it misses and the cure.

    The command line prints it and exits with status 2; a node logs it and publishes it in ~/quality.
    """


class SimulationError(RuntimeError):
    """The simulation left its bounds. The message names frame, substep and particle, and what to lower."""


class _Short(reprlib.Repr):
    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother = 3, SHORT, SHORT

    def repr_int(self, x: int, level: int) -> str:
        bits = x.bit_length()  # repr of thousands of digits takes quadratic time, or is refused
        return repr(x) if bits < 200 else f"a whole number of {bits * 3 // 10} digits"


def short(value: Any) -> str:
    """A value for a message: its repr on one line, cut to about 80 characters, however large or deep it is."""
    text = " ".join(_Short().repr(value).split())
    return text if len(text) <= SHORT else text[: SHORT - 2] + ".."


def shown(path: Any) -> str:
    """A path or a text of somebody else's for a message: on one line, what cannot be printed escaped, cut in the middle to 200 characters."""
    text = str(path)
    if len(text) > LONGEST_PATH:
        text = f"{text[: LONGEST_PATH // 2]}..{text[-LONGEST_PATH // 2 :]}"
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def named(name: Any, most: int = SHORT) -> str:
    """A name of somebody else's for a message, as `shown`, cut in its middle to about `most` characters."""
    text = str(name)
    return shown(text if len(text) <= most else f"{text[: most // 2]}..{text[-(most // 2) :]}")


def listed(names: Iterable[Any], most: int = 6) -> str:
    """The first of several names, separated by commas, and how many more there are."""
    texts = [named(name) for name in names]
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")
