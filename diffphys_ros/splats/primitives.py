"""What the unknowns of both fits are alike: rows of tensors, some of which the fit changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self, TypeVar

import torch


@dataclass(frozen=True)
class Primitives:
    """G Gaussians in some parametrisation; every field is a tensor of G rows."""

    FREE: ClassVar[tuple[str, ...]]  # fields that the fit changes

    @property
    def unknowns(self) -> dict[str, torch.Tensor]:
        """What the fit changes, by name."""
        return {name: getattr(self, name) for name in self.FREE}

    def __len__(self) -> int:
        return len(getattr(self, self.FREE[0]))

    def pick(self, index: torch.Tensor) -> Self:
        """Those at an index or mask, detached."""
        return type(self)(*(getattr(self, f.name).detach()[index] for f in fields(self)))

    def join(self, other: Self) -> Self:
        """These and then the others."""
        return type(self)(*(torch.cat([getattr(self, f.name).detach(), getattr(other, f.name).detach()]) for f in fields(self)))

    def leaves(self) -> Self:
        """The same with fresh unknowns that require gradients."""
        return replace(self, **{name: t.detach().clone().requires_grad_() for name, t in self.unknowns.items()})


AnyPrimitives = TypeVar("AnyPrimitives", bound=Primitives)


def doubled(what: AnyPrimitives, error: torch.Tensor, count: int, two: Callable[[AnyPrimitives], AnyPrimitives]) -> AnyPrimitives:
    """With `two` in the place of each of those with the largest error (G,), until there are `count` or twice as many."""
    room = min(max(count - len(what), 0), len(what))
    chosen = torch.zeros(len(what), dtype=torch.bool, device=error.device)
    chosen[torch.argsort(error, descending=True, stable=True)[:room]] = True
    return what.pick(~chosen).join(two(what.pick(chosen)))


class ShrinkingAdam:
    """Adam whose steps shrink evenly to `last` of the first ones over so many iterations; colours stay within 0..1."""

    def __init__(self, rates: dict[str, float], *, last: float, iterations: int, share: float = 1.0) -> None:
        self._rates, self._last, self._iterations, self._share = rates, last, iterations, share

    def begin(self, what: Primitives, iteration: int = 0) -> None:
        """Take up unknowns, with no memory of earlier ones and the steps of an iteration."""
        share = self._share * self._last ** (iteration / self._iterations)
        groups = [{"params": [t], "lr": share * self._rates[name]} for name, t in what.unknowns.items()]
        self._color, self._adam = what.unknowns["color"], torch.optim.Adam(groups, eps=1e-15)

    def step(self, loss: torch.Tensor) -> None:
        """One step down the gradient of a loss of the unknowns."""
        self._adam.zero_grad()
        loss.backward()
        self._adam.step()
        with torch.no_grad():
            self._color.clamp_(0, 1)
        for group in self._adam.param_groups:
            group["lr"] *= self._last ** (1 / self._iterations)
