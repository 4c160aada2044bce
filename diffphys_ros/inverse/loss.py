"""The loss of the inverse problem (paper Eq. 10, A.12): evidence and priors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import torch

from ..particles import Binding
from .evidence import Evidence, Moved
from .forward import Motion
from .observed import TrackTarget
from .prior import Prior


@dataclass
class Terms:
    """The loss at one point, term by term."""

    motion: Motion | None
    total: torch.Tensor
    parts: dict[str, float] = field(default_factory=dict)

    @property
    def value(self) -> float:
        """The loss; infinite where the simulation left its bounds."""
        return float(self.total.detach())


@dataclass
class Objective:
    """What a motion costs."""

    evidence: Mapping[str, Evidence]  # by kind
    prior: Prior
    target: TrackTarget
    binding: Binding  # of the target's points to the particles
    failures: list[str] = field(default_factory=list)  # what the simulation said where a step went too far
    watch: Callable[[float], None] | None = None  # hears the share of a simulation that is done; may end it by an exception

    def terms(self, z: torch.Tensor, motion: Motion, kinds: Collection[str]) -> Terms:
        """The loss of a motion and of the unknowns z (size,) that it belongs to, by evidence of these kinds."""
        weighted = self.misfits(Moved(motion.x, motion.F, motion.force), kinds) | {"prior": self.prior.value(z)}
        return Terms(motion, _sum(weighted), {name: float(v.detach()) for name, v in weighted.items()})

    def failed(self, why: str) -> Terms:
        """No motion: an infinite loss."""
        self.failures.append(why)
        return Terms(None, torch.tensor(float("inf")))

    def misfits(self, moved: Moved, kinds: Collection[str]) -> dict[str, torch.Tensor]:
        """Weighted misfits by name."""
        return {name: value for kind, term in self.evidence.items() if kind in kinds for name, value in term(moved).items()}

    def misfit(self, moved: Moved) -> float:
        """How badly a motion explains the clip; that of a better explanation is lower."""
        with torch.no_grad():
            return float(_sum(self.misfits(moved, tuple(self.evidence))))

    def track_loss(self, x: torch.Tensor) -> float:
        """TrackTarget.loss of particles x (T, P, 3) [m], whatever tracks weigh."""
        return float(self.target.loss(self.binding.apply((x - x[:1]).detach())))

    def track_rms(self, x: torch.Tensor) -> float:
        """Misfit of one track coordinate [m] of particles x (T, P, 3) [m]."""
        return self.target.rms(self.binding.apply((x - x[:1]).detach()))


def _sum(weighted: dict[str, torch.Tensor]) -> torch.Tensor:
    return sum((v.cpu() for v in weighted.values()), torch.zeros((), dtype=torch.float64))
