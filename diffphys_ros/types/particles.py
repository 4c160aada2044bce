"""What the material-point simulator moves, and the grid that it moves it on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Particles:
    """Material points that fill the body, in the body frame."""

    x_rest: np.ndarray  # [m], shape (P, 3)
    volume: np.ndarray  # [m^3], shape (P,); 0 < volume
    part: np.ndarray  # 1..n, shape (P,)
    density: np.ndarray  # [kg/m^3], shape (P,)
    poisson: np.ndarray  # shape (P,)
    ghost: np.ndarray  # bool, shape (P,): continues the body behind the clamp so that the grid is full there; never
    # published, never weighed

    @property
    def own(self) -> np.ndarray:
        """Indices of the particles that are the body itself."""
        return np.flatnonzero(~self.ghost)

    @property
    def mass(self) -> np.ndarray:
        """[kg], shape (P,)."""
        return self.volume * self.density


@dataclass(frozen=True)
class Grid:
    """A regular grid in the body frame. Node (i, j, k) lies at origin + dx * (i, j, k)."""

    origin: np.ndarray  # [m], shape (3,)
    dx: float  # [m]
    size: tuple[int, int, int]  # nodes along each axis
    clamp_index: int = -1  # nodes with first index <= clamp_index are held (the clamped face lies a sixth of a cell before that plane); -1: none
