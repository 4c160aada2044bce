"""Adam (Kingma and Ba 2015) over fields, as the paper has it, with one second moment a tensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from .descent import Descent, Space
from .model import Model

FIRST, SECOND = 0.9, 0.99  # shares of the moments that stay from step to step: Adam's own but for the second, which has few steps to be known
RISE = 1.02  # of the lowest loss, from which a step has led too far: over a whole clip a force moves all that comes after it
BACK = 0.5  # of the steps, where one led too far, or out of what can be simulated

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
    """The loss before every step, after it; steps shrink to the share `last` of the first. A step that leads too far is taken
    back, and what was learnt from those before it is forgotten."""
    descents = [Momentum(tensor, rate) for tensors, rate in groups for tensor in tensors]
    scale, share = 1.0, last ** (1 / max(iterations - 1, 1))
    for _ in range(iterations):
        loss = evaluate()
        value = float(loss.detach())
        best.see(value)
        if not (math.isfinite(value) and value <= RISE * best.loss):
            best.restore()
            scale, descents = BACK * scale, [Momentum(descent.tensor, descent.rate) for descent in descents]
        else:
            slopes = torch.autograd.grad(loss, [descent.tensor for descent in descents], allow_unused=True)
            for descent, slope in zip(descents, slopes, strict=True):
                if slope is not None:
                    descent.step(slope, scale)
        scale *= share
        yield value


class Momentum:
    """Adam's two moments of one tensor, with one second moment for all of it: what pictures hardly see, behind the surface and along the line
    of sight, is hardly moved, while Adam's own would take steps of one size everywhere and fill it with chance."""

    def __init__(self, tensor: Tensor, rate: float) -> None:
        self.tensor, self.rate, self.count = tensor, rate, 0
        self.first, self.second = torch.zeros_like(tensor), torch.zeros((), dtype=tensor.dtype, device=tensor.device)

    def step(self, slope: Tensor, scale: float) -> None:
        """Against the slope; of root mean square rate * scale at first."""
        self.count += 1
        self.first.lerp_(slope, 1 - FIRST)
        self.second.lerp_(slope.square().mean(), 1 - SECOND)
        size = (self.second / (1 - SECOND**self.count)).sqrt().clamp_min(1e-30)
        with torch.no_grad():
            self.tensor -= self.rate * scale / (1 - FIRST**self.count) * self.first / size


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
