"""The simulator alone: a block, held at one end, is let go under gravity and swings: python examples/simulate_a_block.py

Prints the drop of the free end and the energies frame by frame; what the weight loses, motion and strain take up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from diffphys_ros.simulate import Simulator, State, substeps_per_frame
from diffphys_ros.types import Grid, Particles

LENGTH, SIDE, CELL = 0.2, 0.05, 0.0125  # m
YOUNG, POISSON, DENSITY, GRAVITY = 5e5, 0.3, 1000.0, 9.81  # Pa, 1, kg/m^3, m/s^2
PERIOD_S, MARGIN = 1 / 60, 6  # between frames; cells of free room around the block


def block() -> Simulator:
    """A level block that leaves the held plane x = 0, two particles a cell and axis; gravity along -z."""
    counts = [round(2 * extent / CELL) for extent in (LENGTH, SIDE, SIDE)]
    x = (np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3) + 0.5) * CELL / 2
    every = np.ones(len(x))
    particles = Particles(x, every * (CELL / 2) ** 3, every.astype(int), every * DENSITY, every * POISSON, every < 0)
    nodes = [n // 2 + 2 * MARGIN + 1 for n in counts]
    grid = Grid(np.full(3, -MARGIN * CELL), CELL, (nodes[0], nodes[1], nodes[2]), MARGIN)
    substeps = substeps_per_frame(YOUNG, POISSON, DENSITY, dx=CELL, period_s=PERIOD_S)
    return Simulator(particles, grid, substeps=substeps, period_s=PERIOD_S, gravity=(0.0, 0.0, -GRAVITY))


def energies(sim: Simulator, state: State) -> dict[str, float]:
    """Of motion, of strain (neo-Hookean) and lost by the weight [J]."""
    mu, lam = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    mass, log_j = sim.density * sim.volume, torch.linalg.det(state.F).log()
    strain = mu / 2 * ((state.F**2).sum((1, 2)) - 3) - mu * log_j + lam / 2 * log_j**2
    drop = (sim.x_rest - state.x)[:, 2]
    return {"motion": float((mass * (state.v**2).sum(1)).sum() / 2), "strain": float((sim.volume * strain).sum()), "weight": float((mass * drop).sum() * GRAVITY)}


def swing(frames: int = 30) -> Iterator[tuple[float, float, dict[str, float]]]:
    """Time [s], drop of the free end [m] and energies [J] of every frame."""
    sim = block()
    end = sim.x_rest[:, 0] > LENGTH - CELL
    force = torch.zeros(frames, *sim.x_rest.shape)  # N/m^3, beside the weight
    with torch.no_grad():
        path = sim.rollout(sim.rest(), sim.tensor(YOUNG), sim.tensor(POISSON), force, 0.0)
    for k, data in enumerate(path.data):
        state = State(data)
        yield k * PERIOD_S, float((sim.x_rest - state.x)[end, 2].mean()), energies(sim, state)


if __name__ == "__main__":
    for time_s, drop_m, energy in swing():
        print(f"{time_s:.3f} s  end {1000 * drop_m:5.1f} mm lower  " + "  ".join(f"{name} {1000 * value:6.2f} mJ" for name, value in energy.items()))
