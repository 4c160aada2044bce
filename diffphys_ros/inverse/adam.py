"""Adam (Kingma and Ba 2015) over fields, as the paper has it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from .descent import Descent, Space
from .model import Model

BACK = 0.5  # of the steps, where one led out of what can be simulated

Groups = Sequence[tuple[Sequence[Tensor], float]]  # tensors, and their first step


class Best:
    """The lowest loss so far, and where it was."""

    def __init__(self, tensors: Sequence[Tensor]) -> None:
        self.tensors, self.loss = list(tensors), math.inf
        self.values = [tensor.detach().clone() for tensor in tensors]

    def see(self, loss: float) -> bool:
        """Whether the loss at the tensors' values is the lowest; then these are kept."""
        if not loss < self.loss:
            return False
        self.loss, self.values = loss, [tensor.detach().clone() for tensor in self.tensors]
        return True

    def restore(self) -> None:
        """Give the tensors the values that were best."""
        with torch.no_grad():
            for tensor, value in zip(self.tensors, self.values, strict=True):
                tensor.copy_(value)


def lowered(groups: Groups, iterations: int, last: float, evaluate: Callable[[], Tensor], best: Best) -> Iterator[float]:
    """The loss before every step, after it; steps shrink to the share `last` of the first. A step that leads nowhere is taken back."""
    optimiser = torch.optim.Adam([{"params": list(tensors), "lr": rate} for tensors, rate in groups])
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, last, max(iterations, 1))
    for _ in range(iterations):
        loss = evaluate()
        value = float(loss.detach())
        best.see(value)
        if not math.isfinite(value):
            best.restore()
            schedule.base_lrs = [BACK * rate for rate in schedule.base_lrs]
            for group in optimiser.param_groups:
                group["lr"] *= BACK
        else:
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()
        yield value


def whole_clip(model: Model, space: Space, begun: Descent | None, *, material: bool, iterations: int) -> Iterator[Descent]:
    """The fields over all frames at once; states hold the best values so far. What `begun` has done is not done again."""
    e, force = model.problem.settings.experiment, list(model.force.parameters()) if model.force is not None else []
    within = {id(p) for p in space.parameters}
    slow = e.material_rate if e.transition_iterations else e.force_rate  # what frame by frame was found is only mended
    groups = [([p for p in force if id(p) in within], slow)]
    if material and model.material is not None:
        groups.append((list(model.material.parameters()), e.material_rate))
    best, done = Best(space.parameters), 0 if begun is None else begun.iteration
    groups = [(tensors, rate) for tensors, rate in groups if tensors]
    for k, _ in enumerate(lowered(groups, iterations - done, e.last_rate, lambda: model().total, best)):
        here = [p.detach().clone() for p in space.parameters]
        best.restore()
        yield plain_descent(space.vector(), best.loss, done + k + 1)
        with torch.no_grad():
            for tensor, value in zip(space.parameters, here, strict=True):
                tensor.copy_(value)
    best.restore()


def plain_descent(at: np.ndarray, value: float, iteration: int) -> Descent:
    """A state that remembers no steps."""
    at = at.astype(np.float32)
    none = np.zeros((0, len(at)), np.float32)
    return Descent(at, value, np.zeros_like(at), none, none, iteration)
