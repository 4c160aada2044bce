"""How rough a force field is (paper A.14): its gradient in space and its change in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

MOST_POINTS, NEIGHBOURS = 1500, 10
FLAT = 1e-3  # share of a neighbourhood's extent below which it has none in a direction


@dataclass(frozen=True)
class Smoothness:
    """Gradients at some particles, by least squares over their neighbours."""

    at: Tensor  # particles, (K,)
    near: Tensor  # their neighbours, (K, k)
    slope: Tensor  # gradient from differences to the neighbours, times the object's extent, (K, 3, k)

    @classmethod
    def of(cls, x: np.ndarray, *, device: str = "cpu") -> Smoothness:
        """At no more than MOST_POINTS of the rest positions x (P, 3) [m]."""
        at = np.linspace(0, len(x) - 1, min(MOST_POINTS, len(x))).astype(int)
        near = cKDTree(x).query(x[at], k=min(NEIGHBOURS + 1, len(x)))[1][:, 1:]
        slope = np.linalg.pinv(x[near] - x[at, None], rcond=FLAT) * np.ptp(x, axis=0).max()
        return cls(*(torch.as_tensor(a, device=device) for a in (at, near, slope)))

    def __call__(self, force: Tensor) -> Tensor:
        """Mean squared gradient over the object's extent plus mean squared change from frame to frame, of forces (T, P, 3)."""
        difference = force[:, self.near] - force[:, self.at, None]
        gradient = torch.einsum("nik,tnkc->tnic", self.slope.to(force), difference)
        change = force.diff(dim=0).square().sum(-1).mean() if len(force) > 1 else force.new_zeros(())
        return gradient.square().sum((-1, -2)).mean() + change
