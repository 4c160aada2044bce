"""Features on three planes (Chan et al. 2022, Efficient Geometry-aware 3D Generative Adversarial Networks; paper Eq. 8, A.6, A.8)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

PAIRS = ((0, 1), (0, 2), (1, 2))  # of coordinates, one plane each
SPREAD = 0.3  # standard deviation of features before they are trained


class Triplane(nn.Module):
    """Feature vectors of points in the cube -1 .. 1: the sum of three bilinear look-ups. Beyond the cube the border goes on."""

    def __init__(self, nodes: Sequence[int], *, channels: int, generator: torch.Generator):
        """`nodes` along each of the three coordinates."""
        super().__init__()
        sizes = [(1, channels, nodes[b], nodes[a]) for a, b in PAIRS]
        self.planes = nn.ParameterList(nn.Parameter(SPREAD * torch.randn(size, generator=generator)) for size in sizes)

    def forward(self, u: Tensor) -> Tensor:
        """Features (P, channels) of coordinates (P, 3)."""
        features = [_read(plane, u[:, list(pair)]) for plane, pair in zip(self.planes, PAIRS, strict=True)]
        return features[0] + features[1] + features[2]


def _read(plane: Tensor, uv: Tensor) -> Tensor:
    found = nn.functional.grid_sample(plane, uv[None, None], mode="bilinear", padding_mode="border", align_corners=True)
    return found[0, :, 0].T
