"""Descent over tensors from a given first metric: L-BFGS with backtracking (Nocedal and Wright, Numerical Optimization, chapter 7).

Where the metric is the inverse Hessian of the linear engine (Gauss-Newton), the first steps are near-Newton steps although only gradients
of the simulation are known; what is remembered of the steps then says what the linear engine does not. With all steps remembered this is
BFGS. Fields of many parameters have no such metric: a clip pins some combinations of them down a thousand times better than others, so
that steps of equal size in all of them, as Adam takes, go nowhere near an optimum.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

FIRST_STEP = 0.05  # length of the first without a metric, in units of the parameters
TRIES = 5  # steps of decreasing length before a direction is given up
ARMIJO = 1e-4
SHRINK, LEAST_SHRINK, MOST_SHRINK = 0.3, 0.1, 0.6  # of a rejected step, where a parabola does not say or outside these
FLAT = 5e-3  # relative decrease that counts as no progress
CURVED = 1e-10  # cosine between a step and the change of the slope from which it is remembered

Limit = Callable[[np.ndarray, np.ndarray], float]


class Space:
    """Tensors as one vector, on the processor, in double precision."""

    def __init__(self, parameters: Sequence[Tensor]):
        self.parameters = list(parameters)

    def vector(self) -> np.ndarray:
        """The values as they are, (n,)."""
        return torch.cat([p.detach().double().cpu().reshape(-1) for p in self.parameters]).numpy()

    def assign(self, vector: np.ndarray) -> None:
        """Give the tensors the values of a vector."""
        pieces = torch.from_numpy(vector).split([p.numel() for p in self.parameters])
        with torch.no_grad():
            for parameter, piece in zip(self.parameters, pieces, strict=True):
                parameter.copy_(piece.reshape(parameter.shape))

    def gradient(self, loss: Tensor) -> np.ndarray:
        """d(loss)/d(vector), (n,)."""
        found = torch.autograd.grad(loss, self.parameters, allow_unused=True)
        pieces = (torch.zeros_like(p) if g is None else g for p, g in zip(self.parameters, found, strict=True))
        return torch.cat([piece.double().cpu().reshape(-1) for piece in pieces]).numpy()


@dataclass(frozen=True)
class Rules:
    """How a descent goes."""

    metric: np.ndarray | None = None  # first inverse Hessian, (n, n); None: that of the last step, in all directions alike
    limit: Limit | None = None  # which share (0..1] of a step from a point is allowed
    memory: int | None = None  # steps that are remembered; None: all
    patience: int | None = 2  # iterations in a row without progress that end it; None: none do


@dataclass(frozen=True)
class Descent:
    """State of the search: everything that a checkpoint must hold."""

    at: np.ndarray  # values of the tensors, (n,)
    value: float  # of the loss; infinite where there is none
    slope: np.ndarray  # d(value)/d(at), (n,); zeros where there is no value
    steps: np.ndarray  # remembered, oldest first, (k, n)
    changes: np.ndarray  # of the slope along each, (k, n)
    iteration: int = 0
    flat: int = 0  # iterations in a row without progress
    finished: bool = False  # no step is left that lowers the loss

    def done(self, rules: Rules) -> bool:
        """Whether going on is pointless."""
        return self.finished or not math.isfinite(self.value) or (rules.patience is not None and self.flat >= rules.patience)


def begin(space: Space, loss: Tensor) -> Descent:
    """Iteration 0 where the tensors are, with their loss."""
    at, value = space.vector(), float(loss.detach())
    none = np.zeros((0, len(at)))
    return Descent(at, value, space.gradient(loss) if math.isfinite(value) else np.zeros_like(at), none, none)


def descend(space: Space, evaluate: Callable[[], Tensor], state: Descent, rules: Rules) -> Iterator[Descent]:
    """Yields the state after every iteration; the tensors then hold the values that gave it. `evaluate` is the loss at the tensors' values;
    infinite where there is none."""
    while not state.done(rules) and float(np.linalg.norm(state.slope)) > 0:
        state = _advance(space, evaluate, state, rules)
        yield state


def _advance(space: Space, evaluate: Callable[[], Tensor], state: Descent, rules: Rules) -> Descent:
    direction = _direction(state, rules.metric)
    direction = direction * (rules.limit(state.at, direction) if rules.limit else 1.0)
    found = _search(space, evaluate, state, direction)
    if found is not None:
        return _after(state, found[0], float(found[1].detach()), space.gradient(found[1]), rules.memory)
    space.assign(state.at)
    none = np.zeros((0, len(state.at)))  # what was learnt may mislead: once more by the metric alone
    return replace(state, steps=none, changes=none, iteration=state.iteration + 1, flat=state.flat + 1, finished=not len(state.steps))


def _search(space: Space, evaluate: Callable[[], Tensor], state: Descent, direction: np.ndarray) -> tuple[np.ndarray, Tensor] | None:
    """The first step that lowers the loss enough, and the loss there; None where TRIES do not find one."""
    share, downhill = 1.0, float(state.slope @ direction)
    for _ in range(TRIES):
        space.assign(state.at + share * direction)
        loss = evaluate()
        after = float(loss.detach())
        if math.isfinite(after) and after <= state.value + ARMIJO * share * downhill:
            return share * direction, loss
        del loss  # with its history, which is as large as that of the next one
        share *= _shrink(state.value, after, share * downhill)
    return None


def _shrink(before: float, after: float, slope: float) -> float:
    """Minimum of the parabola through both values and the slope, kept within sane shares."""
    bend = after - before - slope
    if not math.isfinite(after) or bend <= 0:
        return SHRINK
    return float(np.clip(-slope / (2 * bend), LEAST_SHRINK, MOST_SHRINK))


def _after(state: Descent, step: np.ndarray, value: float, slope: np.ndarray, memory: int | None) -> Descent:
    """The state one step on; the step is remembered where the slope rises along it."""
    change, steps, changes = slope - state.slope, state.steps, state.changes
    if float(step @ change) > CURVED * float(np.linalg.norm(step) * np.linalg.norm(change)):
        kept = slice(None) if memory is None else slice(-memory, None)
        steps, changes = np.vstack([steps, step])[kept], np.vstack([changes, change])[kept]
    progress = state.value - value > FLAT * abs(state.value)
    return Descent(state.at + step, value, slope, steps, changes, state.iteration + 1, 0 if progress else state.flat + 1)


def _direction(state: Descent, metric: np.ndarray | None) -> np.ndarray:
    """Minus the inverse Hessian times the slope, from the metric and the remembered steps (two-loop recursion)."""
    rest, shares = state.slope.copy(), []
    pairs = list(zip(state.steps, state.changes, strict=True))
    for step, change in reversed(pairs):
        shares.append(float(step @ rest) / float(step @ change))
        rest -= shares[-1] * change
    rest = _first(rest, pairs, state.slope, metric)
    for (step, change), share in zip(pairs, reversed(shares), strict=True):
        rest += step * (share - float(change @ rest) / float(step @ change))
    return -rest


def _first(rest: np.ndarray, pairs: list[tuple[np.ndarray, np.ndarray]], slope: np.ndarray, metric: np.ndarray | None) -> np.ndarray:
    if metric is not None:
        return np.asarray(metric @ rest)
    if not pairs:
        return rest * (FIRST_STEP / float(np.linalg.norm(slope)))
    step, change = pairs[-1]
    return rest * (float(step @ change) / float(change @ change))
