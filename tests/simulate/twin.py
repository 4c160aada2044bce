"""One substep of the simulator again, in plain torch: the reference for values and gradients."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor

from diffphys_ros.simulate import State
from diffphys_ros.types import Grid

from .laws import energies


def substep(
    state: State,
    grid: Grid,
    dt: float,
    *,
    law: str,
    young: Tensor,
    poisson: Tensor,
    density: Tensor,
    volume: Tensor,
    force: Tensor,
    gravity: Tensor,
    mass_damping: Tensor,
    law_parameters: dict[str, Tensor],
) -> State:
    """State after one substep; shapes as in Simulator.frame."""
    x, v, C, F = state.x, state.v, state.C, state.F
    mu, lam = young / (2 * (1 + poisson)), young * poisson / ((1 + poisson) * (1 - 2 * poisson))
    own = [*law_parameters.values(), torch.zeros_like(mu), torch.zeros_like(mu)]
    constants = torch.stack([mu, lam, *own[:2]], -1)
    mass, affine = density * volume, 4 / grid.dx**2
    nodes, weight, arm = stencil(x, grid)
    tau = energies.stress(law, F, constants) + energies.viscous_stress(law, F, C, constants)
    A = mass[:, None, None] * C - (affine * dt * volume)[:, None, None] * tau
    b = mass[:, None] * v + dt * volume[:, None] * (force + density[:, None] * gravity)
    momentum = (b[:, None] + arm @ A.mT) * weight[..., None]
    count = grid.size[0] * grid.size[1] * grid.size[2]
    node_momentum = torch.zeros(count, 3, dtype=x.dtype).index_add(0, nodes.flatten(), momentum.flatten(0, 1))
    node_mass = torch.zeros(count, dtype=x.dtype).index_add(0, nodes.flatten(), (weight * mass[:, None]).flatten())
    node_velocity = torch.exp(-mass_damping * dt) * node_momentum / node_mass.clamp_min(1e-30)[:, None]
    free = (torch.arange(count) // (grid.size[1] * grid.size[2]) > grid.clamp_index).to(x.dtype)
    gathered = (node_velocity * free[:, None])[nodes]
    v = (weight[..., None] * gathered).sum(1)
    C = affine * torch.einsum("pn,pna,pnb->pab", weight, gathered, arm)
    return State.assemble(x + dt * v, v, C, energies.project(law, F + dt * C @ F, constants))


def stencil(x: Tensor, grid: Grid) -> tuple[Tensor, Tensor, Tensor]:
    """Flat node indices (P, 27), weights (P, 27) and arms x_i - x (P, 27, 3) of the quadratic B-spline."""
    cells = (x - torch.tensor(grid.origin, dtype=x.dtype)) / grid.dx
    base = torch.floor(cells.detach() - 0.5)
    offsets = torch.tensor(list(itertools.product(range(3), repeat=3)))
    distance = cells[:, None] - (base[:, None] + offsets)
    near = 0.75 - distance**2
    far = 0.5 * (1.5 - distance.abs()) ** 2
    weight = torch.where(distance.abs() < 0.5, near, far).prod(-1)
    index = base[:, None].long() + offsets
    nodes = (index[..., 0] * grid.size[1] + index[..., 1]) * grid.size[2] + index[..., 2]
    return nodes, weight, -distance * grid.dx
