"""Errors that a user can act on."""

from __future__ import annotations

from collections.abc import Iterable


class InputError(ValueError):
    """Bad input. The message is one sentence that names the input, the bound it misses and the cure.

    The command line prints it and exits with status 2; a node logs it and publishes it in ~/quality.
    """


class SimulationError(RuntimeError):
    """The simulation left its bounds. The message names frame, substep and particle, and what to lower."""


def shown(value: object, most: int = 80) -> str:
    """What a user or a file gave, for a sentence: one line of printable characters, cut in its middle beyond `most` of them."""
    text = str(value)
    if len(text) > most:
        text = f"{text[: most // 2]} ... {text[-(most // 3) :]}"
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def listed(values: Iterable[object], most: int = 6) -> str:
    """The first of several such values, separated by commas, and how many more there are."""
    named = [shown(value) for value in values]
    return ", ".join(named[:most]) + (f" and {len(named) - most} more" if len(named) > most else "")
