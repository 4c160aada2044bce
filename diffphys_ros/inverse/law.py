"""The constitutive law that a fit simulates with."""

from __future__ import annotations

from ..config import Settings
from ..errors import InputError, short
from ..simulate.laws import LAWS


def law_to_fit(settings: Settings) -> str:
    """fit.law, if it names an elastic law. Raises InputError."""
    name, elastic = settings.fit.law, [law for law, made in LAWS.items() if made.elastic]
    if name not in elastic:
        why = "flows, while start values come from vibrations about a rest shape" if name in LAWS else "is unknown"
        raise InputError(f"fit.law: {short(name)} {why}; choose one of {', '.join(elastic)}")
    return name
