"""The material field (paper Eq. 1, 8, A.6, A.7): rest positions in, Young's modulus and Poisson's ratio out.

Constants belong to matter: fields are asked at rest positions (the paper asks at current ones, which drift).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor, nn

from .box import Box
from .decoder import HIDDEN, Bounds, Decoder
from .triplane import Triplane

POISSON_BOUNDS = Bounds(0.0, 0.49)
NODES, CHANNELS = 24, 16  # along the longest side of the box; of a feature vector


@dataclass(frozen=True)
class MaterialSizes:
    """How fine a material field is."""

    nodes: int = NODES  # of a plane, along the longest side of the box
    channels: int = CHANNELS  # of a feature vector
    hidden: int = HIDDEN  # width of the decoders


class Material(NamedTuple):
    """What a material field says at P points."""

    young: Tensor  # [Pa], (P,)
    poisson: Tensor  # (P,)


@dataclass(frozen=True)
class Believed:
    """Values known at points, taken for the nearest of them elsewhere."""

    points: np.ndarray  # rest positions [m], (M, 3)
    young: np.ndarray  # [Pa], (M,)
    poisson: np.ndarray  # (M,)

    def at(self, x: Tensor) -> Material:
        """The values at x (P, 3) [m]."""
        index = cKDTree(self.points).query(x.detach().double().cpu().numpy())[1]
        return Material(*(torch.as_tensor(a[index], dtype=x.dtype, device=x.device) for a in (self.young, self.poisson)))


class MaterialField(nn.Module):
    """The door of every material field."""

    def forward(self, x: Tensor) -> Material:
        """Material at rest positions x (P, 3) [m], differentiable in the field's parameters."""
        raise NotImplementedError


class PartMaterial(MaterialField):
    """One modulus and one ratio for all points that carry the same values in the belief (paper: a constant per part)."""

    def __init__(self, believed: Believed, bounds: Bounds, *, generator: torch.Generator, sizes: MaterialSizes | None = None):
        super().__init__()
        self.believed, self.bounds = believed, bounds
        self.levels, self.level = np.unique(np.stack([believed.young, believed.poisson], -1), axis=0, return_inverse=True)
        self.raw = nn.Parameter(torch.zeros(len(self.levels), 2))

    def forward(self, x: Tensor) -> Material:
        index = cKDTree(self.believed.points).query(x.detach().double().cpu().numpy())[1]
        raw = self.raw[torch.as_tensor(self.level.ravel()[index], device=x.device)]
        return _moved(self.believed.at(x), raw, self.bounds)


class TriplaneMaterial(MaterialField):
    """Triplane features and two bounded heads (paper Eq. 8); knows nothing until it is pretrained."""

    def __init__(self, believed: Believed, bounds: Bounds, *, generator: torch.Generator, sizes: MaterialSizes | None = None):
        super().__init__()
        sizes = sizes or MaterialSizes()
        self.bounds, self.box = bounds, Box.around(believed.points)
        self.features = Triplane(self.box.cells(sizes.nodes), channels=sizes.channels, generator=generator)
        self.young, self.poisson = (Decoder(sizes.channels, 1, generator=generator, hidden=sizes.hidden) for _ in range(2))

    def raw(self, x: Tensor) -> Tensor:
        """What the two heads say before bounds, (P, 2)."""
        features = self.features(self.box.unit(x))
        return torch.cat([self.young(features), self.poisson(features)], -1)

    def forward(self, x: Tensor) -> Material:
        raw = self.raw(x)
        return Material(self.bounds.value(raw[:, 0]), POISSON_BOUNDS.value(raw[:, 1]))


class ResidualMaterial(TriplaneMaterial):
    """The belief, corrected by triplane features and two heads (paper A.7); exactly the belief until it is trained."""

    def __init__(self, believed: Believed, bounds: Bounds, *, generator: torch.Generator, sizes: MaterialSizes | None = None):
        super().__init__(believed, bounds, generator=generator, sizes=sizes)
        self.believed = believed

    def forward(self, x: Tensor) -> Material:
        return _moved(self.believed.at(x), self.raw(x), self.bounds)


def _moved(base: Material, raw: Tensor, bounds: Bounds) -> Material:
    return Material(bounds.shifted(base.young, raw[:, 0]), POISSON_BOUNDS.shifted(base.poisson, raw[:, 1]))


MATERIAL_FIELDS: dict[str, Callable[..., MaterialField]] = {"part": PartMaterial, "triplane": TriplaneMaterial, "residual": ResidualMaterial}
