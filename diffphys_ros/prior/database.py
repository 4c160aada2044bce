"""The fixed material database: works without a network."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..config import loaded, read_text
from ..errors import InputError, short

FILE = Path(__file__).with_name("materials.yaml")
UNKNOWN = "soft solid"  # the entry for objects of which nothing is known
SDS_PER_RANGE = 4.0  # standard deviations of log E between an entry's lowest and highest value


@dataclass(frozen=True)
class Span:
    """Lowest, typical and highest value of what goes by a material's name."""

    low: float
    typical: float
    high: float


@dataclass(frozen=True)
class Material:
    """One entry of the database."""

    name: str
    aliases: tuple[str, ...]
    young: Span  # [Pa]
    poisson: Span
    density: Span  # [kg/m^3]

    @property
    def log10_young_sd(self) -> float:
        """Standard deviation of log10 E over all that goes by the name."""
        return float(np.log10(self.young.high / self.young.low)) / SDS_PER_RANGE


@cache
def materials() -> dict[str, Material]:
    """Every entry by name, in the order of the file."""
    entries = loaded(read_text(FILE, str(FILE)), str(FILE))
    found = (Material(e["name"], tuple(e["aliases"]), Span(*e["E"]), Span(*e["nu"]), Span(*e["rho"])) for e in entries)
    return {material.name: material for material in found}


def known(name: str) -> Material | None:
    """The entry that goes by a name or an alias; case, hyphens and a plural s do not count. None where there is none."""
    return _by_any_name().get(_plain(name)) or _by_any_name().get(_plain(name).removesuffix("s"))


def find(name: str, origin: str) -> Material:
    """The entry that goes by a name; `origin` says in words where it stands. Raises InputError with the nearest names."""
    entry = known(name)
    if entry is None:
        close = difflib.get_close_matches(_plain(name[:100]), _by_any_name(), 3, 0.5) or list(materials())[:5]
        raise InputError(f"{origin}: material {short(name)} is not in the database; choose one such as {', '.join(close)}, or give E, nu and rho")
    return entry


@cache
def _by_any_name() -> dict[str, Material]:
    return {_plain(name): material for material in materials().values() for name in (material.name, *material.aliases)}


def _plain(name: str) -> str:
    return " ".join(name.lower().replace("-", " ").replace("_", " ").split())
