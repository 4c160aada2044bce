"""What every kind of evidence may ask for, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import torch

from ...config import Experiment
from ...particles import Binding
from ..carried import CarriedGaussians
from ..observed import TrackTarget
from ..prepared import Prepared


@dataclass(frozen=True)
class Moved:
    """How the particles moved and what acted on them, body frame, whichever engine moved them."""

    x: torch.Tensor  # positions [m], (T, P, 3)
    F: torch.Tensor  # deformation gradients since frame 0, (T, P, 3, 3)
    force: torch.Tensor  # density [N/m^3 of rest volume] from each frame to the next, (T - 1, P, 3)


class Evidence(Protocol):
    """Misfits of a motion, by name and weighted."""

    def __call__(self, moved: Moved) -> dict[str, torch.Tensor]:
        """Differentiable."""
        ...


@dataclass(frozen=True)
class Told:
    """The clip, and how particles follow and show it."""

    prepared: Prepared
    weights: Experiment
    x_rest: torch.Tensor  # of the particles, as simulated [m], (P, 3)
    volume: torch.Tensor  # of the particles at rest [m^3], (P,)
    target: TrackTarget
    binding: Binding  # of the target's points to the particles
    shown: CarriedGaussians | None  # None without Gaussians
    every: int  # frames from one that is rendered to the next
