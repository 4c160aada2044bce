"""Densities of parts that nobody told, where only the mass of all is known or assumed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..config import Scene
from ..types import Body

DENSITY_CONTRAST = 0.5  # of ln(density) of a part when only the mass of all is given: neighbours differ by factors, as foam on rubber, fruit on a stalk [chosen]

OTHERWISE = 2.0  # standard deviations [numerical]


def told_by_motion(body: Body) -> bool:
    """Whether the motion may tell the densities of a body's parts. Without a length its place is assumed, its plane across the line of sight and its
    thickness: densities would explain what these miss."""
    return body.scale.length


@dataclass(frozen=True)
class Densities:
    """What the densities of n parts may be: all of the same mass, each part's logarithm with a standard deviation about the assumed one."""

    assumed: np.ndarray  # [kg/m^3], (n,)
    volume: np.ndarray  # [m^3], (n,)
    contrast: float  # standard deviation of ln(density)

    @classmethod
    def open(cls, body: Body, scene: Scene) -> Densities | None:
        """Those of a body; None where a person told them, one part has all the mass, or the body's shape is assumed."""
        if scene.density_kg_m3 is not None or body.parts == 1 or not told_by_motion(body):
            return None
        return cls(np.asarray(body.density, float), body.part_volumes_m3, DENSITY_CONTRAST)

    def of(self, unknown: np.ndarray) -> np.ndarray:
        """Densities [kg/m^3] (n,) of unknowns (n,) with a unit normal prior; the mass stays."""
        density = self.assumed * np.exp(self.contrast * unknown)
        return density * (self.assumed @ self.volume) / (density @ self.volume)

    def unknown(self, density: np.ndarray | None) -> np.ndarray:
        """The inverse of `of`, (n,); zeros for the assumed ones."""
        return np.zeros(len(self.assumed)) if density is None else np.log(density / self.assumed) / self.contrast

    def slope(self, density: np.ndarray) -> np.ndarray:
        """Derivatives (n, n) of log densities by the unknowns, at densities (n,)."""
        mass = density * self.volume
        return self.contrast * (np.eye(len(mass)) - mass / mass.sum())

    def others(self, density: np.ndarray | None) -> list[np.ndarray]:
        """Densities to begin a search from as well: each part much heavier and much lighter than given."""
        return [self.of(self.unknown(density) + far) for part in np.eye(len(self.assumed)) for far in (OTHERWISE * part, -OTHERWISE * part)]
