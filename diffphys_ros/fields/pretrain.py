"""A material field brought to a belief before anything is simulated (paper section 3.2: MSE regression)."""

from __future__ import annotations

import torch
from torch import Tensor

from .decoder import Bounds
from .material import POISSON_BOUNDS, Material, MaterialField

STEPS, RATE, LAST_RATE = 400, 1e-2, 0.05  # of Adam; the last is the share of the rate at the end


def pretrain(field: MaterialField, x: Tensor, target: Material, bounds: Bounds, *, steps: int = STEPS) -> float:
    """Least squares of log E and nu at rest positions x (P, 3) [m], each over the width of its bounds; returns the root mean
    squared misfit of log10 E that is left."""
    wanted_young, wanted_poisson = bounds.share(target.young), POISSON_BOUNDS.share(target.poisson)
    optimiser = torch.optim.Adam(field.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, LAST_RATE, steps)
    for _ in range(steps):
        said = field(x)
        loss = (bounds.share(said.young) - wanted_young).square().mean() + (POISSON_BOUNDS.share(said.poisson) - wanted_poisson).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    with torch.no_grad():
        return float((field(x).young / target.young).log10().square().mean().sqrt())
