"""The bodies that the speed of the simulator is measured on: cantilevers of a given number of particles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from diffphys_ros.simulate import Simulator, substeps_per_frame
from diffphys_ros.types import Grid, Particles

YOUNG, POISSON, DENSITY, PERIOD_S, MASS_DAMPING, GRAVITY = 2e5, 0.3, 1000.0, 1 / 30, 0.5, (0.0, 0.0, -9.81)
BEAM_M = np.array([0.3, 0.06, 0.06])
CLAMP_NODE = 3  # of the plane that the beam leaves


@dataclass(frozen=True)
class Case:
    """The first `particles` of a lattice of `counts` in a beam with `cells` over its thickness, in a cube of `nodes`."""

    particles: int
    counts: tuple[int, int, int]
    cells: int
    nodes: int

    @property
    def dx(self) -> float:
        """[m]"""
        return float(BEAM_M[2]) / self.cells

    @property
    def substeps(self) -> int:
        """A frame."""
        return substeps_per_frame(YOUNG, POISSON, DENSITY, dx=self.dx, period_s=PERIOD_S)

    @property
    def body(self) -> Particles:
        """The particles."""
        pitch = BEAM_M / self.counts
        axes = [(np.arange(n) + 0.5) * h for n, h in zip(self.counts, pitch, strict=True)]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)[: self.particles]
        each = np.ones(self.particles)
        return Particles(x, each * np.prod(pitch), each.astype(int), each * DENSITY, each * POISSON, each < 0)

    @property
    def grid(self) -> Grid:
        """A cube of nodes around the beam."""
        middle = np.array([CLAMP_NODE, self.nodes // 2 - self.cells // 2, self.nodes // 2 - self.cells // 2])
        return Grid(-self.dx * middle, self.dx, (self.nodes,) * 3, CLAMP_NODE)

    def simulator(self, device: str, *, batch: int | None = None, memory_budget_mb: float = 512.0) -> Simulator:
        """A simulator of it in single precision."""
        options = {"gravity": GRAVITY, "device": device, "batch": batch, "memory_budget_mb": memory_budget_mb}
        return Simulator(self.body, self.grid, substeps=self.substeps, period_s=PERIOD_S, **options)  # type: ignore[arg-type]


CASES = {
    "1335_32": Case(1335, (38, 6, 6), 4, 32),
    "1335_64": Case(1335, (38, 6, 6), 4, 64),
    "5k_64": Case(5000, (50, 10, 10), 5, 64),
    "20k_64": Case(20_000, (80, 16, 16), 8, 64),
    "100k_64": Case(100_000, (140, 28, 28), 10, 64),
    "100k_128": Case(100_000, (140, 28, 28), 14, 128),
}
