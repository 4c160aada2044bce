"""Quasi-Newton minimisation over many parameters (L-BFGS with backtracking; Nocedal and Wright, Numerical Optimization, chapter 7).

A clip pins some combinations of a field's parameters down a thousand times better than others (a frequency against a pattern of
stiffness): steps of equal size in all of them, as Adam takes, go nowhere near an optimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True)
class Descent:
    """State of the search: everything that a checkpoint must hold."""

    at: Tensor  # values of the tensors, (n,)
    value: float
    slope: Tensor  # d(value)/d(at), (n,); zeros where there is no value
    steps: tuple[Tensor, ...] = ()  # remembered, oldest first, (n,) each
    changes: tuple[Tensor, ...] = ()  # of the slope along each

    def after(self, step: Tensor, value: float, slope: Tensor) -> Descent:
        """The state one step on; the step is remembered where the slope rises along it."""
        change, steps, changes = slope - self.slope, self.steps, self.changes
        if float(step @ change) > 1e-10 * float(step.norm() * change.norm()):
            steps, changes = (*steps, step)[-MEMORY:], (*changes, change)[-MEMORY:]
        return Descent(self.at + step, value, slope, steps, changes)


def descend(space: Space, evaluate: Callable[[], Tensor], state: Descent | None = None) -> Iterator[Descent]:
    """Yields the state at the tensors' values, or goes on from `state` without yielding it, and the state after every step; the
    tensors then hold the values that gave it. Ends where no step is left that lowers the loss. `evaluate` is the loss at the
    tensors' values; infinite where there is none."""
    if state is None:
        state = _here(space, evaluate())
        yield state
    while math.isfinite(state.value) and float(state.slope.norm()) > 0:
        found = _search(space, evaluate, state)
        if found is None:
            space.assign(state.at)
            if not state.steps:
                return
            state = Descent(state.at, state.value, state.slope)  # what was learnt may mislead: once more straight downhill
            continue
        step, loss = found
        state = state.after(step, float(loss.detach()), space.gradient(loss))
        yield state


def _here(space: Space, loss: Tensor) -> Descent:
    at, value = space.vector(), float(loss.detach())
    return Descent(at, value, space.gradient(loss) if math.isfinite(value) else torch.zeros_like(at))


def _search(space: Space, evaluate: Callable[[], Tensor], state: Descent) -> tuple[Tensor, Tensor] | None:
    """The first step that lowers the loss enough, and the loss there; None where TRIES do not find one."""
    at, value, direction = state.at, state.value, _direction(state)
    share, downhill = 1.0, float(state.slope @ direction)
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


def _direction(state: Descent) -> Tensor:
    """Minus the inverse Hessian times the gradient, from the remembered steps and changes of the gradient (two-loop recursion)."""
    if not state.steps:
        return -state.slope * (FIRST_STEP / state.slope.norm())
    rest, shares = state.slope.clone(), []
    pairs = list(zip(state.steps, state.changes, strict=True))
    for step, change in reversed(pairs):
        shares.append((step @ rest) / (step @ change))
        rest -= shares[-1] * change
    step, change = pairs[-1]
    rest *= (step @ change) / (change @ change)
    for (step, change), share in zip(pairs, reversed(shares), strict=True):
        rest += step * (share - (change @ rest) / (step @ change))
    return -rest
