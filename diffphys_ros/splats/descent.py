"""The one fit of Gaussians to pictures, for every parametrisation: Adam over views, with adaptive density on the way."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import torch

from ..types import Camera
from .density import Shown, prune_and_double
from .group import Group
from .primitives import AnyPrimitives, Primitives, Tensors

ASKED = 16  # most views that say how many Gaussians there must be, and where the pictures are wrong
TOGETHER = {"cpu": 1, "cuda": 4}  # most views in one step, where they share a camera


@dataclass(frozen=True)
class DescentPlan:
    """How long, with which steps and towards how many Gaussians."""

    iterations: int
    rates: Mapping[str, float]  # first step of each unknown, in its own unit
    last_rate: float  # of the steps at the end over those at the start
    ssim_weight: float
    seed: int  # of the order of the views
    counts: Mapping[int, int] = field(default_factory=dict)  # most Gaussians from an iteration on, at which they are pruned and doubled


def descend(
    what: AnyPrimitives, groups: list[Group], plan: DescentPlan, *, settled: Callable[[AnyPrimitives], AnyPrimitives] = lambda what: what
) -> Generator[tuple[int, int, float], None, AnyPrimitives]:
    """Gaussians with unknowns that require gradients, fitted to all views; yields (iteration, iterations, loss). Steps change the unknowns
    in place. `settled` may change what the fit does not, whenever the number of Gaussians has changed."""
    descent, steps, generator = ShrinkingAdam(plan), _order(groups, plan.seed), torch.Generator().manual_seed(0)
    descent.begin(what)
    standing = [what.standing(group.views) for group in groups]
    for iteration in range(plan.iterations):
        if iteration in plan.counts:
            what = settled(prune_and_double(what, _shown(what, groups, standing), plan.counts[iteration])).leaves()
            descent.begin(what, iteration)
            standing = [what.standing(group.views) for group in groups]
        number, index = next(steps)
        group = groups[number]
        seen = standing[number](what.disturbed(group.rasterizer.camera, generator), index)
        loss = group.loss(seen, index, ssim_weight=plan.ssim_weight)
        descent.step(loss)
        yield iteration + 1, plan.iterations, float(loss.detach())
    return what


def _order(groups: list[Group], seed: int) -> Iterator[tuple[int, list[int]]]:
    """Group and views of every step, without end: all views once in random order, then again in another."""
    generator = torch.Generator().manual_seed(seed)
    while True:
        steps: list[tuple[int, list[int]]] = []
        for number, group in enumerate(groups):
            order = torch.randperm(len(group.views), generator=generator).tolist()
            size = TOGETHER[group.rasterizer.device.type]
            steps += [(number, order[k : k + size]) for k in range(0, len(order), size)]
        yield from (steps[k] for k in torch.randperm(len(steps), generator=generator).tolist())


def _shown(what: AnyPrimitives, groups: list[Group], standing: list[Callable[[AnyPrimitives, list[int]], Tensors]]) -> Shown:
    """What the views say, or ASKED of them: errors are sums over views."""
    every = [(number, k) for number, group in enumerate(groups) for k in range(len(group.views))]
    chosen = [every[k] for k in np.unique(np.linspace(0, len(every) - 1, ASKED).round().astype(int))]
    error, cover, spread = (torch.zeros_like(what.logit, requires_grad=False) for _ in range(3))
    for number, k in chosen:
        group, seen = groups[number], standing[number](what, [k])
        observed, mask = group.observed([k])[0], group.mask[k]
        wrong, filled = group.under(seen, k, partial(_residual, observed, mask))
        error, cover = error + wrong, torch.maximum(cover, filled)
        spread = torch.maximum(spread, torch.where(filled > 0, _spread(standing[number](what.unmoved, [k]), group.rasterizer.camera), 0.0))
    return Shown(error, cover, spread)


def _residual(observed: torch.Tensor, mask: torch.Tensor, image: torch.Tensor, depth: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared, on the object (h, w), and the object (h, w)."""
    return (observed - image).square().sum(-1) * mask, mask.float()


def _spread(gaussians: Tensors, camera: Camera) -> torch.Tensor:
    """Largest standard deviation over the width of the picture (G,)."""
    mean, _, scale = (t.detach() for t in gaussians[:3])
    line, eye = mean.new_tensor(camera.world_from_camera[:3, 2]), mean.new_tensor(camera.position)
    return scale.amax(1) * camera.focal_px / ((mean[0] - eye) @ line).clamp_min(1e-6) / camera.width


class ShrinkingAdam:
    """Adam (Kingma and Ba 2015) whose steps shrink evenly over the iterations of a plan; colours stay within 0..1.

    Written out, because the first use of torch.optim imports torch's compiler, which costs every run two seconds."""

    MEAN, SQUARE, TINY = 0.9, 0.999, 1e-15  # what is kept of the running means at a step; floor of the divisor

    def __init__(self, plan: DescentPlan) -> None:
        self._rates, self._last, self._iterations = plan.rates, plan.last_rate, plan.iterations

    def begin(self, what: Primitives, iteration: int = 0) -> None:
        """Take up unknowns, with no memory of earlier ones and the steps of an iteration."""
        self._unknowns, self._steps = what.unknowns, 0
        self._size = self._last ** (iteration / self._iterations)
        self._means = {name: (torch.zeros_like(t), torch.zeros_like(t)) for name, t in self._unknowns.items()}

    def step(self, loss: torch.Tensor) -> None:
        """One step down the gradient of a loss of the unknowns."""
        for t in self._unknowns.values():
            t.grad = None
        loss.backward()
        self._steps += 1
        with torch.no_grad():
            for name, t in self._unknowns.items():
                if t.grad is not None:
                    self._move(t, t.grad, *self._means[name], self._size * self._rates[name])
            self._unknowns["color"].clamp_(0, 1)
        self._size *= self._last ** (1 / self._iterations)

    def _move(self, t: torch.Tensor, slope: torch.Tensor, mean: torch.Tensor, square: torch.Tensor, size: float) -> None:
        """Both means begin at 0 and are scaled up for it."""
        mean.lerp_(slope, 1 - self.MEAN)
        square.mul_(self.SQUARE).addcmul_(slope, slope, value=1 - self.SQUARE)
        divisor = (square.sqrt() / (1 - self.SQUARE**self._steps) ** 0.5).add_(self.TINY)
        t.addcdiv_(mean, divisor, value=-size / (1 - self.MEAN**self._steps))
