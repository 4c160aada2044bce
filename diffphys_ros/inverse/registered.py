"""Settings that name an entry of a dict of the code, and what they may name: a new entry needs no other line."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from .law import laws_to_fit
from .stages import SCHEDULES

REGISTERED: dict[str, Callable[[], Iterable[str]]] = {"fit.law": laws_to_fit, "experiment.schedule": lambda: SCHEDULES}


def registered(name: str) -> str:
    """The words that a setting may be, in the order of their dict; empty for one that asks no dict."""
    return ", ".join(REGISTERED[name]()) if name in REGISTERED else ""
