"""Small bodies that the tests simulate: blocks of particles on grids fitted to them."""

from __future__ import annotations

import math

import numpy as np
import torch

from diffphys_ros.simulate import Simulator
from diffphys_ros.types import Grid, Particles


def block(
    cells: tuple[int, int, int],
    *,
    dx: float,
    per_cell: float = 2.0,
    clamped: bool = True,
    margin: int = 3,
    offset: float = 0.0,
    density: float = 1000.0,
    poisson: float = 0.3,
    jitter: float = 0.0,
) -> tuple[Particles, Grid]:
    """A block of `cells` that leaves the plane x = 0, with `margin` cells of room; `offset` shifts the grid, in cells."""
    counts = [round(c * per_cell) for c in cells]
    steps = [c * dx / n for c, n in zip(cells, counts, strict=True)]
    axes = [(np.arange(n) + 0.5) * h for n, h in zip(counts, steps, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    x += np.random.default_rng(0).uniform(-jitter, jitter, x.shape) * dx
    count = len(x)
    particles = Particles(
        x_rest=x,
        volume=np.full(count, math.prod(steps)),
        part=np.ones(count, int),
        density=np.full(count, density),
        poisson=np.full(count, poisson),
        ghost=np.zeros(count, bool),
    )
    size = tuple(c + 2 * margin + 1 for c in cells)
    return particles, Grid(np.full(3, -(margin + offset) * dx), dx, size, margin if clamped else -1)  # type: ignore[arg-type]


def simulator(body: tuple[Particles, Grid], *, substeps: int, period_s: float, **options: object) -> Simulator:
    """A simulator of a block in double precision."""
    return Simulator(*body, substeps=substeps, period_s=period_s, **{"dtype": torch.float64, **options})  # type: ignore[arg-type]


def full(sim: Simulator, value: float) -> torch.Tensor:
    """One value per particle, shape (P,)."""
    return torch.full_like(sim.volume, value)


def masses(sim: Simulator) -> torch.Tensor:
    """[kg], shape (P,)."""
    return sim.density * sim.volume
