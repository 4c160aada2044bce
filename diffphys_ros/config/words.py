"""Settings from the words of a command line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

from ..errors import InputError, short, shown
from .files import parse_text
from .leaf import leaves
from .moved import moved
from .values import build

COMMANDS_OWN = ("config", "out", "resume", "help")  # flags that are no settings, which a misspelt word may mean as well


def flags_of(given: Iterable[str]) -> dict[str, Any]:
    """Values by dotted name: `--scene.mass_kg 0.8` or `--scene.mass_kg=0.8`. Raises InputError."""
    known, words, values = leaves(), list(given), dict[str, Any]()
    while words:
        word = words.pop(0)
        if not word.startswith("--"):
            raise InputError(f"command line: {short(word)} is not a flag; settings look like `--scene.mass_kg 0.8`")
        name, joined, text = word[2:].partition("=")
        if name not in known and moved(name):
            raise InputError(f"command line: --{name} {moved(name)}")
        if name not in known:
            raise InputError(f"command line: --{shown(name[:80])} is no flag{_nearest(name)}")
        if name in values:
            raise InputError(f"command line: --{name} is given twice; keep one")
        if not joined:
            if not words or words[0].startswith("--"):
                raise InputError(f"command line: --{name} has no value; give {known[name].doc}, such as `--{name} {known[name].example}`")
            text = words.pop(0)
        values[name] = parse_text(known[name], text)
    build(values, "command line")
    return values


def _nearest(name: str) -> str:
    close = difflib.get_close_matches(name[:100], [*leaves(), *COMMANDS_OWN], 1, 0.4)
    return f"; did you mean --{close[0]}?" if close else "; `diffphys settings` lists every setting"
