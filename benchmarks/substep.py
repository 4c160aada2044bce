"""Time of one simulator substep, forward and backward, replays included: python benchmarks/substep.py [cpu] [cuda]

A beam of 1,335 particles, four cells over the thickness, one whole differentiated frame; the median of several. The
rows ending in _replayed keep nothing between the passes (memory_budget_mb = 0), the others what the default keeps.
"""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import replace

import numpy as np
import torch
from table import Row, record, row

from diffphys_ros.simulate import Simulator, substeps_per_frame
from diffphys_ros.types import Grid, Particles

PARTICLES, DX, YOUNG, POISSON, DENSITY, PERIOD_S = 1335, 0.015, 2e5, 0.3, 1000.0, 1 / 30
BEAM_M, COUNTS = (0.3, 0.06, 0.06), (38, 6, 6)
REPEATS = 9


def beam() -> Particles:
    """The first 1,335 particles of a clamped beam's lattice."""
    pitch = [m / n for m, n in zip(BEAM_M, COUNTS, strict=True)]
    axes = [(np.arange(n) + 0.5) * h for n, h in zip(COUNTS, pitch, strict=True)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)[:PARTICLES]
    each = np.ones(PARTICLES)
    return Particles(x, each * np.prod(pitch), each.astype(int), each * DENSITY, each * POISSON, np.zeros(PARTICLES, bool))


def grid(nodes: int) -> Grid:
    """A cube of nodes around the beam, which leaves the third plane."""
    middle = np.array([3, nodes // 2 - 2, nodes // 2 - 2])
    return Grid(-DX * middle, DX, (nodes, nodes, nodes), 3)


def seconds(sim: Simulator) -> float:
    """Median time of a differentiated frame, over its substeps [s]."""
    young = torch.full_like(sim.volume, YOUNG, requires_grad=True)
    force = torch.zeros_like(sim.x_rest, requires_grad=True)
    times = []
    for _ in range(REPEATS + 1):
        start = clock(sim)
        state = sim.frame(sim.rest(), young, sim.tensor(POISSON), force, 0.5)
        state.x[:, 1].sum().backward()
        times.append(clock(sim) - start)
    return statistics.median(times[1:]) / sim.substeps


def clock(sim: Simulator) -> float:
    """Time at which everything launched so far has ended [s]."""
    if sim.volume.device.type == "cuda":
        torch.cuda.synchronize(sim.volume.device)
    return time.perf_counter()


def measure(name: str, unit: str, *, nodes: int, device: str) -> list[Row]:
    """Rows of one device."""
    substeps = substeps_per_frame(YOUNG, POISSON, DENSITY, dx=DX, period_s=PERIOD_S)
    scale = {"ms": 1e3, "us": 1e6}[unit]
    rows = []
    for suffix, budget in (("", {}), ("_replayed", {"memory_budget_mb": 0.0})):
        sim = Simulator(beam(), grid(nodes), substeps=substeps, period_s=PERIOD_S, gravity=(0, 0, -9.81), device=device, **budget)
        rows.append(row(name + suffix, scale * seconds(sim), unit, device=device))
    return rows


def main() -> None:
    """Measure the devices named, or what this machine has; its processor on one core."""
    torch.set_num_threads(1)
    wanted = sys.argv[1:] or ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    rows: list[Row] = []
    if "cpu" in wanted:
        rows += [replace(r, device=f"{r.device} (one core)") for r in measure("substep_cpu_1335_32", "ms", nodes=32, device="cpu")]
    if "cuda" in wanted:
        rows += measure("substep_single_1335_64", "us", nodes=64, device="cuda:0")
    record(rows)


if __name__ == "__main__":
    main()
