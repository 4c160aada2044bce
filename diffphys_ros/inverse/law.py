"""The constitutive law that a fit simulates with."""

from __future__ import annotations

from ..config import Settings
from ..errors import InputError, short
from ..simulate.laws import LAWS


def laws_to_fit() -> list[str]:
    """Names of the laws of solids, whose start values come from vibrations about a rest shape."""
    return [name for name, law in LAWS.items() if law.elastic]


def law_to_fit(settings: Settings) -> str:
    """fit.law, if it names an elastic law. Raises InputError."""
    name = settings.fit.law
    if name not in laws_to_fit():
        why = "flows, while start values come from vibrations about a rest shape" if name in LAWS else "is unknown"
        raise InputError(f"fit.law: {short(name)} {why}; choose one of {', '.join(laws_to_fit())}")
    return name
