"""Where on the body a force acts: density [N/m^3 of rest volume] = amplitude(t) * weight(rest position), by family."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .errors import InputError

Family = Callable[[np.ndarray, np.ndarray], np.ndarray]


def uniform(points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """Weight 1 everywhere, (P,): wind across a small body, an inertial force."""
    return np.ones(len(points))


def gaussian(points: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """A local push: Gaussian of the in-plane distance from (x, y) [m, body] with width sigma [m]; parameters (3,)."""
    distance2 = ((points[:, :2] - parameters[:2]) ** 2).sum(1)
    return np.exp(-0.5 * distance2 / parameters[2] ** 2)


FAMILIES: dict[str, Family] = {"uniform": uniform, "gaussian": gaussian}


@dataclass(frozen=True)
class Footprint:
    """A member of a family."""

    family: str = "uniform"  # a name in FAMILIES
    parameters: np.ndarray = field(default_factory=lambda: np.zeros(0))  # uniform: (0,); gaussian: centre x, y and sigma [m], body, (3,)

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (P,) at rest positions (P, 3) [m, body frame]. Raises InputError for an unknown family."""
        if self.family not in FAMILIES:
            raise InputError(f"force family {self.family!r} is unknown; the known ones are {', '.join(FAMILIES)}")
        return FAMILIES[self.family](points, self.parameters)
