"""What brakes a motion in proportion to mass and to stiffness: the damping matrix alpha M + beta K."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, SupportsFloat, TypeVar

import numpy as np

Number = TypeVar("Number", bound=SupportsFloat)  # float, or a torch tensor () that carries gradients


@dataclass(frozen=True)
class Damping(Generic[Number]):
    """Both constants."""

    STORED: ClassVar[dict[str, str]] = {"mass_damping": "mass_per_s", "stiffness_damping": "stiffness_s"}  # names in files, see store.encoded

    mass_per_s: Number  # alpha [1/s]: force density -alpha rho v
    stiffness_s: Number  # beta [s]: Kelvin-Voigt stress beta C : d(strain)/dt

    def decay(self: Damping[float], omega2: np.ndarray) -> np.ndarray:
        """Rates (r,) [1/s] at which modes of squared angular frequencies omega2 (r,) [1/s^2] decay."""
        return 0.5 * (self.mass_per_s + self.stiffness_s * omega2)

    def braking(self: Damping[float], omega2: float) -> Damping[float]:
        """Constants of which none is below 0, under which a mode of squared angular frequency omega2 [1/s^2] decays as under these, if it decays: by a
        negative one other modes gain energy without bound."""
        if min(self.mass_per_s, self.stiffness_s) >= 0:
            return self
        whole = max(self.mass_per_s + self.stiffness_s * omega2, 0.0)
        by_mass = min(max(self.mass_per_s, 0.0), whole)
        return Damping(by_mass, (whole - by_mass) / omega2)

    def numbers(self) -> Damping[float]:
        """The same without gradients."""
        return Damping(float(self.mass_per_s), float(self.stiffness_s))

    def stored(self) -> dict[str, Number]:
        """Both by their names in files."""
        return {name: getattr(self, own) for name, own in self.STORED.items()}

    @classmethod
    def of_stored(cls, values: Mapping[str, Any]) -> Damping[float]:
        """From what a file holds. Raises KeyError."""
        return Damping(**{own: float(values[name]) for name, own in cls.STORED.items()})
