"""What nobody told of the materials, as unknowns of the free motion: densities of the parts, and their Poisson's ratios."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..config import Scene
from ..types import Body
from .densities import Densities, told_by_motion

POISSON_SD = 0.1  # when nothing is given: foams have .1 and less, metals .3, rubber and tissue .45 and more [derived: standard deviation of an even spread]
LEAST_POISSON, MOST_POISSON = 0.0, 0.49  # that a search may find [chosen]
UNLIKELY = 5.0  # standard deviations beyond which no density is looked for [numerical]


def poisson_sds(body: Body, scene: Scene) -> np.ndarray:
    """Standard deviations of the parts' Poisson's ratios before anything is seen, (n,); 0 where they were told."""
    return np.zeros(body.parts) if scene.poisson_ratio is not None else np.minimum(POISSON_SD, (0.5 - body.poisson) / 2)


@dataclass(frozen=True)
class Ratios:
    """What Poisson's ratios of n parts may be: each with a standard deviation about the assumed one."""

    assumed: np.ndarray  # (n,)
    sd: np.ndarray  # (n,)

    @classmethod
    def open(cls, body: Body, scene: Scene) -> Ratios | None:
        """Those of a body; None where a person told them, or the body's shape is assumed."""
        if scene.poisson_ratio is not None or not told_by_motion(body):
            return None
        return cls(np.asarray(body.poisson, float), poisson_sds(body, scene))

    def of(self, unknown: np.ndarray) -> np.ndarray:
        """Poisson's ratios (n,) of unknowns (n,) with a unit normal prior."""
        return self.assumed + self.sd * unknown

    def unknown(self, poisson: np.ndarray | None) -> np.ndarray:
        """The inverse of `of`, (n,); zeros for the assumed ones."""
        return np.zeros(len(self.assumed)) if poisson is None else (poisson - self.assumed) / self.sd


@dataclass(frozen=True)
class Untold:
    """Both, each None where it is told; the unknowns of a search, each with a unit normal prior, are those of the densities, then those of the ratios."""

    densities: Densities | None = None
    ratios: Ratios | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(len(each.assumed) for each in (self.densities, self.ratios) if each is not None)

    def of(self, unknown: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Densities (n,) [kg/m^3] and Poisson's ratios (n,); None for what is told."""
        first = 0 if self.densities is None else len(self.densities.assumed)
        return None if self.densities is None else self.densities.of(unknown[:first]), None if self.ratios is None else self.ratios.of(unknown[first:])

    def unknown(self, density: np.ndarray | None, poisson: np.ndarray | None) -> np.ndarray:
        """The inverse of `of`; zeros for what is as assumed."""
        pairs = (self.densities, density), (self.ratios, poisson)
        return np.concatenate([np.zeros(0), *(each.unknown(value) for each, value in pairs if each is not None)])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the unknowns in a search."""
        most = np.full(0 if self.densities is None else len(self.densities.assumed), UNLIKELY)
        low, high = (np.zeros(0),) * 2 if self.ratios is None else (self.ratios.unknown(np.full(len(self.ratios.sd), end)) for end in (LEAST_POISSON, MOST_POISSON))
        return np.r_[-most, np.minimum(low, 0.0)], np.r_[most, np.maximum(high, 0.0)]

    def slope(self, density: np.ndarray | None) -> np.ndarray:
        """Derivatives of log densities, then of Poisson's ratios, by the unknowns, (size, size); at densities (n,)."""
        blocks = np.zeros((self.size, self.size))
        first = 0
        if self.densities is not None and density is not None:
            first = len(density)
            blocks[:first, :first] = self.densities.slope(density)
        if self.ratios is not None:
            blocks[first:, first:] = np.diag(self.ratios.sd)
        return blocks


TOLD = Untold()
