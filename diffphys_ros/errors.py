"""Errors that a user can act on."""

from __future__ import annotations

import reprlib
from typing import Any

MAX_SHOWN = 80  # characters of a value in a sentence


def short(value: Any) -> str:
    """A value as a sentence quotes it: its repr, with the middle left out where it is longer than MAX_SHOWN."""
    shown = _SHORT.repr(value)
    half = (MAX_SHOWN - 3) // 2
    return shown if len(shown) <= MAX_SHOWN else f"{shown[:half]}...{shown[-half:]}"


_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = MAX_SHOWN


class InputError(ValueError):
    """Bad input. The message is one sentence that names the input, the bound it misses and the cure.

    The command line prints it and exits with status 2; a node logs it and publishes it in ~/quality.
    """


class SimulationError(RuntimeError):
    """The simulation left its bounds. The message names frame, substep and particle, and what to lower."""
