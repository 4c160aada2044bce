"""From features to bounded numbers: small perceptrons and smooth bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

HIDDEN = 32  # width of a perceptron, where nobody says
SLOPE = 4.0  # of the last weights: the two layers before halve a small signal each
BORDER = 0.02  # of the bounds' width: a value nearer to an end moves as one so far off, else it could not leave


class Decoder(nn.Module):
    """Perceptron of two hidden layers whose output is zero for every input until it is trained."""

    def __init__(self, channels: int, out: int, *, generator: torch.Generator, hidden: int = HIDDEN):
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(channels, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU(), nn.Linear(hidden, out))
        linear = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        with torch.no_grad():
            for layer in linear[:-1]:
                layer.weight.normal_(0.0, math.sqrt(2.0 / layer.in_features), generator=generator)
                layer.bias.zero_()
            linear[-1].weight.zero_()
            linear[-1].bias.zero_()

    def awaken(self, generator: torch.Generator) -> None:
        """Zero from now on where features are zero, and there alone: a step of size one in the features changes each output by about one."""
        last = self.layers[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.normal_(0.0, SLOPE / math.sqrt(last.in_features), generator=generator)

    def forward(self, features: Tensor) -> Tensor:
        """Values (..., out) of features (..., channels)."""
        return self.layers(features)


@dataclass(frozen=True)
class Bounds:
    """Numbers between `low` and `high`, from any real number by a sigmoid; spaced evenly, or where `log` in the logarithm."""

    low: float
    high: float
    log: bool = False

    def value(self, raw: Tensor) -> Tensor:
        """Bounded values of raw numbers; 0 is the middle."""
        return self._outer(torch.sigmoid(raw)).clamp(self.low, self.high)

    def shifted(self, base: Tensor, raw: Tensor) -> Tensor:
        """`base`, which lies between the bounds, moved by raw numbers: exactly `base` at 0, and never beyond the bounds."""
        start = torch.logit(self.share(base).clamp(BORDER, 1 - BORDER))
        moved = (torch.sigmoid(start + raw) - torch.sigmoid(start)) * self._width  # exactly 0 at 0: nothing is lost to rounding
        return (base * torch.exp(moved) if self.log else base + moved).clamp(self.low, self.high)

    def share(self, value: Tensor) -> Tensor:
        """Where values lie between the bounds, 0 .. 1."""
        inner = (torch.log(value) - math.log(self.low)) if self.log else value - self.low
        return inner / self._width

    @property
    def _width(self) -> float:
        return math.log(self.high / self.low) if self.log else self.high - self.low

    def _outer(self, share: Tensor) -> Tensor:
        return self.low * torch.exp(share * self._width) if self.log else self.low + share * self._width
