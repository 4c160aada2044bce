"""Quasi-Newton minimisation over many parameters (L-BFGS with backtracking; Nocedal and Wright, Numerical Optimization, chapter 7).

A clip pins some combinations of a field's parameters down a thousand times better than others (a frequency against a pattern of
stiffness): steps of equal size in all of them, as Adam takes, go nowhere near an optimum.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

MEMORY = 15  # steps whose curvature is remembered
FIRST_STEP = 0.05  # length of the first, in units of the parameters
TRIES, ARMIJO, LEAST_SHRINK, MOST_SHRINK = 6, 1e-4, 0.1, 0.5


class Space:
    """Tensors as one vector, on the processor, in double precision."""

    def __init__(self, parameters: Sequence[Tensor]):
        self.parameters = list(parameters)

    def vector(self) -> Tensor:
        """The values as they are."""
        return torch.cat([p.detach().double().cpu().reshape(-1) for p in self.parameters])

    def assign(self, vector: Tensor) -> None:
        """Give the tensors the values of a vector."""
        pieces = vector.split([p.numel() for p in self.parameters])
        with torch.no_grad():
            for parameter, piece in zip(self.parameters, pieces, strict=True):
                parameter.copy_(piece.reshape(parameter.shape))

    def gradient(self, loss: Tensor) -> Tensor:
        """d(loss)/d(vector)."""
        found = torch.autograd.grad(loss, self.parameters, allow_unused=True)
        pieces = (torch.zeros_like(p) if g is None else g for p, g in zip(self.parameters, found, strict=True))
        return torch.cat([piece.double().cpu().reshape(-1) for piece in pieces])


def descend(space: Space, evaluate: Callable[[], Tensor]) -> Iterator[float]:
    """Yields the loss at the start and after every step; the tensors then hold the values that gave it. Ends where no step is
    left that lowers it. `evaluate` is the loss at the tensors' values; infinite where there is none."""
    loss = evaluate()
    at, value = space.vector(), float(loss.detach())
    yield value
    if not math.isfinite(value):
        return
    slope, pairs = space.gradient(loss), deque[tuple[Tensor, Tensor]](maxlen=MEMORY)
    while float(slope.norm()) > 0:
        found = _search(space, evaluate, at, value, slope, _direction(slope, pairs))
        if found is None:
            space.assign(at)
            if not pairs:
                return
            pairs.clear()  # what was learnt may mislead: once more straight downhill
            continue
        step, loss = found
        before, slope = slope, space.gradient(loss)
        at, value = at + step, float(loss.detach())
        if float(step @ (slope - before)) > 1e-10 * float(step.norm() * (slope - before).norm()):
            pairs.append((step, slope - before))
        yield value


def _search(space: Space, evaluate: Callable[[], Tensor], at: Tensor, value: float, slope: Tensor, direction: Tensor) -> tuple[Tensor, Tensor] | None:
    """The first step along a direction that lowers the loss enough, and the loss there; None where TRIES do not find one."""
    share, downhill = 1.0, float(slope @ direction)
    for _ in range(TRIES):
        space.assign(at + share * direction)
        loss = evaluate()
        after = float(loss.detach())
        if math.isfinite(after) and after <= value + ARMIJO * share * downhill:
            return share * direction, loss
        bend = after - value - share * downhill
        best = -share * downhill / (2 * bend) if math.isfinite(bend) and bend > 0 else LEAST_SHRINK
        share *= min(max(best, LEAST_SHRINK), MOST_SHRINK)
    return None


def _direction(slope: Tensor, pairs: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
    """Minus the inverse Hessian times the gradient, from the remembered steps and changes of the gradient (two-loop recursion)."""
    if not pairs:
        return -slope * (FIRST_STEP / slope.norm())
    rest, shares = slope.clone(), []
    for step, change in reversed(pairs):
        shares.append((step @ rest) / (step @ change))
        rest -= shares[-1] * change
    step, change = pairs[-1]
    rest *= (step @ change) / (change @ change)
    for (step, change), share in zip(pairs, reversed(shares), strict=True):
        rest += step * (share - (change @ rest) / (step @ change))
    return -rest
