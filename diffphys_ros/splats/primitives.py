"""What Gaussians of every parametrisation are to the fit: rows of tensors, some of which it changes, and how they stand in pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self, TypeVar

import torch

from ..types import Camera, Splats
from .view import View

Tensors = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]
"""Mean (..., G, 3) [m, world], rotation (..., G, 4) wxyz, scale (G, 3) [m], opacity (G,) and colour (G, 3) as the renderer takes them."""


@dataclass(frozen=True)
class Primitives(ABC):
    """G Gaussians in some parametrisation; every field is a tensor of G rows. All have log_scale (G, A) [m] and logit (G,)."""

    FREE: ClassVar[tuple[str, ...]]  # fields that the fit changes

    log_scale: torch.Tensor
    logit: torch.Tensor

    @property
    def unknowns(self) -> dict[str, torch.Tensor]:
        """What the fit changes, by name."""
        return {name: getattr(self, name) for name in self.FREE}

    def __len__(self) -> int:
        return len(self.logit)

    def pick(self, index: torch.Tensor) -> Self:
        """Those at an index or mask, detached."""
        return replace(self, **{f.name: getattr(self, f.name).detach()[index] for f in fields(self)})

    def join(self, other: Self) -> Self:
        """These and then the others."""
        return replace(self, **{f.name: torch.cat([getattr(self, f.name).detach(), getattr(other, f.name).detach()]) for f in fields(self)})

    def leaves(self) -> Self:
        """The same with fresh unknowns that require gradients."""
        return replace(self, **{name: t.detach().clone().requires_grad_() for name, t in self.unknowns.items()})

    @abstractmethod
    def standing(self, views: Sequence[View]) -> Callable[[Self, list[int]], Tensors]:
        """How these Gaussians, as a step has changed them, stand in some of the views, which share a camera: mean (B, G, 3), rotation
        (B, G, 4) and what the views share; differentiable. It holds until their number changes."""

    def disturbed(self, camera: Camera, generator: torch.Generator) -> Self:
        """What a step sees in their place; themselves."""
        return self

    @property
    def unmoved(self) -> Self:
        """With their means where they were when their number last changed, where that is kept."""
        return self

    @abstractmethod
    def stepped(self, axis: torch.Tensor, length: torch.Tensor) -> Self:
        """Each moved along one of its own axes (G,) by a length (G,) [m]."""

    @property
    def halved(self) -> torch.Tensor:
        """Which become halves where they are doubled, bool (G,): all. Of the others come two of the same size."""
        return torch.ones_like(self.logit, dtype=torch.bool)


AnyPrimitives = TypeVar("AnyPrimitives", bound=Primitives)


def as_splats(gaussians: Tensors) -> Splats:
    """Gaussians of one frame as data."""
    return Splats(*(t.detach().cpu().numpy() for t in gaussians))
