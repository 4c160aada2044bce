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


class Evidence(Protocol):
    """Misfits of a motion, by name and weighted."""

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> dict[str, torch.Tensor]:
        """Of particles x (T, P, 3) [m], F (T, P, 3, 3) since frame 0, body frame, whatever moved them; differentiable."""
        ...


@dataclass(frozen=True)
class Told:
    """The clip, and how particles follow and show it."""

    prepared: Prepared
    weights: Experiment
    x_rest: torch.Tensor  # of the particles, as simulated [m], (P, 3)
    target: TrackTarget
    binding: Binding  # of the target's points to the particles
    shown: CarriedGaussians | None  # None without Gaussians
    every: int  # frames from one that is rendered to the next
