"""In what unit stiffness and force of an answer are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

UNTOLD = ("assumed", "unknown")  # how the words for what nobody told begin


class Quantity(NamedTuple):
    """Numbers with what they are."""

    values: np.ndarray
    name: str
    unit: str  # SI; empty for a ratio


@dataclass(frozen=True)
class Scale:
    """Which of the scales that motion does not tell were told or measured.

    Motion tells Young's modulus over density, in lengths of the object: with a length E / density [m^2/s^2] and force / mass [m/s^2],
    with a density as well E [Pa] and force [N], without a length the ratios alone.
    """

    density: bool
    length: bool

    @classmethod
    def of(cls, sources: Mapping[str, object], suffix: str = "") -> Scale:
        """From the words that say what fixed `density` and `metric_scale`, under these names with a suffix."""
        density, length = (not str(sources.get(f"{name}{suffix}", UNTOLD[1])).startswith(UNTOLD) for name in ("density", "metric_scale"))
        return cls(density, length)

    def taken(self, allow_assumed: bool) -> Scale:
        """The scale in which an answer is published: absolute where what was assumed is allowed to pass for known (publish.allow_assumed_scale)."""
        return TOLD if allow_assumed else self

    @property
    def absolute(self) -> bool:
        """Whether pascals and newtons are known."""
        return self.density and self.length

    @property
    def words(self) -> str:
        """What holds, in a clause."""
        if self.absolute:
            return "absolute"
        if self.length:
            return "relative: nobody told a mass or a density, so E/density and force over mass are known, but no pascals and no newtons"
        return "relative: nobody told a length, so ratios of stiffness and of force are known, but no pascals and no newtons"

    def stiffness(self, young: np.ndarray, density: np.ndarray) -> Quantity:
        """What is known of Young's moduli [Pa] at densities [kg/m^3], NaN where nothing is, all of one shape."""
        if self.absolute:
            return Quantity(young, "E", "Pa")
        if self.length:
            return Quantity(young / density, "E/density", "m^2/s^2")
        return Quantity(young / max(np.nanmax(young, initial=0.0), np.finfo(float).tiny), "E over the largest", "")

    def force(self, net: np.ndarray, mass_kg: float) -> Quantity:
        """What is known of forces (..., 3) [N] on a body of this mass."""
        if self.absolute:
            return Quantity(net, "net force", "N")
        if self.length:
            return Quantity(net / mass_kg, "net force over mass", "m/s^2")
        peak = float(np.linalg.norm(net, axis=-1).max(initial=0.0))
        return Quantity(net / peak if peak else net, "net force over its peak", "")


TOLD = Scale(density=True, length=True)
