"""The force field (paper Eq. 2, 9, A.8): positions and frames in, force densities out.

Positions are those at rest, so that a force moves with the body, or those at the start of the frame, so that it stays in space.
All begin at zero: nothing is known of a force before the motion is looked at. Row t acts between frames t and t + 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from .box import Box
from .decoder import HIDDEN, Decoder
from .triplane import SPREAD, Triplane

VOXELS, PLANE_NODES, CHANNELS = 10, 16, 8  # along the longest side; of planes; of a feature vector
MODES = 4  # of ModalForce


@dataclass(frozen=True)
class ForceSizes:
    """How fine a force field is."""

    voxels: int = VOXELS  # along the longest side of the box
    planes: int = PLANE_NODES  # the same of planes
    channels: int = CHANNELS  # of a feature vector
    hidden: int = HIDDEN  # width of the decoder


class ForceField(nn.Module):
    """The door of every force field."""

    def __init__(self, box: Box, frames: int, unit: float):
        """`frames` T of the clip; `unit` [N/m^3] is the size of force that a parameter of order one stands for."""
        super().__init__()
        self.box, self.frames, self.unit = box, frames, unit

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        """Force density (F, P, 3) [N/m^3 of rest volume], body frame, at positions x (P, 3) [m] in frames t (F,) of whole
        numbers 0 .. T - 1; differentiable in x as in the field's parameters."""
        raise NotImplementedError


class FrameForce(ForceField):
    """One vector per frame, the same everywhere."""

    def __init__(self, box: Box, frames: int, unit: float, *, generator: torch.Generator, sizes: ForceSizes | None = None):
        super().__init__(box, frames, unit)
        self.amplitude = nn.Parameter(torch.zeros(frames, 3))

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        return self.unit * self.amplitude[t][:, None].expand(-1, len(x), -1)


class ModalForce(ForceField):
    """Smooth modes along the object: per frame a few vectors times cosines of the first body axis, which leaves the clamp."""

    def __init__(self, box: Box, frames: int, unit: float, *, generator: torch.Generator, sizes: ForceSizes | None = None):
        super().__init__(box, frames, unit)
        self.amplitude = nn.Parameter(torch.zeros(frames, MODES, 3))

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        along = (self.box.unit(x)[:, 0] + 1) * (math.pi / 2)
        shapes = torch.cos(along[:, None] * torch.arange(MODES, dtype=x.dtype, device=x.device))
        return self.unit * torch.einsum("pk,fkc->fpc", shapes, self.amplitude[t])


class VoxelForce(ForceField):
    """A feature vector per voxel and frame, trilinear in between, and one decoder for all (paper Eq. 9)."""

    def __init__(self, box: Box, frames: int, unit: float, *, generator: torch.Generator, sizes: ForceSizes | None = None):
        super().__init__(box, frames, unit)
        sizes = sizes or ForceSizes()
        nx, ny, nz = box.cells(sizes.voxels)
        self.features = nn.Parameter(SPREAD * torch.randn((frames, sizes.channels, nz, ny, nx), generator=generator))
        self.decoder = Decoder(sizes.channels, 3, generator=generator, hidden=sizes.hidden)

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        where = self.box.unit(x)[None, None, None].expand(len(t), -1, -1, -1, -1)
        found = nn.functional.grid_sample(self.features[t], where, mode="bilinear", padding_mode="border", align_corners=True)
        return self.unit * self.decoder(found[:, :, 0, 0].transpose(1, 2))


class NodeForce(ForceField):
    """A feature vector per voxel and frame, trilinear in between, and one decoder for all, at places that are known beforehand: the nodes of
    the simulator's grid (paper Eq. 9). Voxels that no place lies between are left out. Features begin at zero, where the decoder is zero too, so
    that frames can be sought one after the other while the decoder stays as it is."""

    near: Tensor  # the eight voxels about each place, (P, 8)
    weight: Tensor  # of these, (P, 8)

    def __init__(self, box: Box, frames: int, unit: float, *, places: np.ndarray, generator: torch.Generator, sizes: ForceSizes | None = None):
        """`places` (P, 3) [m]."""
        super().__init__(box, frames, unit)
        sizes = sizes or ForceSizes()
        index, weight = _trilinear(box, places, sizes.voxels)
        used, near = np.unique(index, return_inverse=True)
        self.register_buffer("near", torch.as_tensor(near.reshape(index.shape)))
        self.register_buffer("weight", torch.as_tensor(weight, dtype=torch.float32))
        self.features = nn.Parameter(torch.zeros(frames, len(used), sizes.channels))
        self.decoder = Decoder(sizes.channels, 3, generator=generator, hidden=sizes.hidden)
        self.decoder.awaken(generator)

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        """As in every field; x (P, 3) are the places that it was made for, in their order."""
        return self.decoded(self.features[t])

    def decoded(self, features: Tensor) -> Tensor:
        """Force densities (F, P, 3) [N/m^3] of features (F, voxels, channels)."""
        found = self.weight[:, :1] * features.index_select(1, self.near[:, 0])
        for corner in range(1, 8):
            found = found + self.weight[:, corner, None] * features.index_select(1, self.near[:, corner])
        return self.unit * self.decoder(found)


def _trilinear(box: Box, places: np.ndarray, along_longest: int) -> tuple[np.ndarray, np.ndarray]:
    """The eight voxels about each place (P, 3) [m] as flat numbers (P, 8), and their weights (P, 8)."""
    count = np.array(box.cells(along_longest))
    u = np.clip((places - box.low) / box.size, 0, 1) * (count - 1)
    low = np.minimum(np.floor(u).astype(int), count - 2)
    corner = np.stack(np.meshgrid(*3 * [np.arange(2)], indexing="ij"), -1).reshape(8, 3)
    share = np.where(corner, (u - low)[:, None], 1 - (u - low)[:, None]).prod(-1)
    index = np.ravel_multi_index(tuple(np.moveaxis(low[:, None] + corner, -1, 0)), tuple(count))
    return index, share


class PlaneForce(ForceField):
    """A triplane over x, y and time, and a decoder (paper A.8): the same through the thickness, smooth in time."""

    def __init__(self, box: Box, frames: int, unit: float, *, generator: torch.Generator, sizes: ForceSizes | None = None):
        super().__init__(box, frames, unit)
        sizes = sizes or ForceSizes()
        nx, ny, _ = box.cells(sizes.planes)
        self.features = Triplane((nx, ny, max(frames, 2)), channels=sizes.channels, generator=generator)
        self.decoder = Decoder(sizes.channels, 3, generator=generator, hidden=sizes.hidden)

    def forward(self, x: Tensor, t: Tensor) -> Tensor:
        place = self.box.unit(x)[:, :2]
        time = 2 * t.to(x) / max(self.frames - 1, 1) - 1
        u = torch.cat([place[None].expand(len(t), -1, -1), time[:, None, None].expand(-1, len(x), 1)], -1)
        return self.unit * self.decoder(self.features(u.flatten(0, 1))).unflatten(0, (len(t), len(x)))


FORCE_FIELDS: dict[str, Callable[..., ForceField]] = {"frame": FrameForce, "modes": ModalForce, "voxels": VoxelForce, "planes": PlaneForce}
