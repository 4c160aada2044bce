"""A bar of two parts and what is believed of it."""

from __future__ import annotations

import numpy as np
import torch

from diffphys_ros.fields import Believed, Bounds, Box

YOUNG = Bounds(1e3, 1e7, log=True)
STIFF, SOFT = 2e5, 2e4


def bar_points(count: int = 20) -> np.ndarray:
    """Lattice points of a bar of 0.4 x 0.1 x 0.06 m, (P, 3)."""
    axes = np.linspace(0.01, 0.39, count), np.linspace(-0.045, 0.045, 5), np.linspace(-0.02, 0.02, 3)
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def two_parts(points: np.ndarray) -> Believed:
    """Stiff up to the middle, soft beyond."""
    near = points[:, 0] < 0.2
    return Believed(points, np.where(near, STIFF, SOFT), np.where(near, 0.3, 0.4))


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def box() -> Box:
    return Box.around(bar_points())
