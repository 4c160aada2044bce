"""What the kernels are given and what they return, as torch tensors."""

from __future__ import annotations

from dataclasses import dataclass

import torch

Tensors = tuple[torch.Tensor, ...]


@dataclass(frozen=True)
class Scene:
    """Contiguous float32 tensors of one device."""

    mean: torch.Tensor  # (T, G, 3) [m], world
    rotation: torch.Tensor  # (T, G, 4) wxyz
    scale: torch.Tensor  # (G, 3) [m]
    opacity: torch.Tensor  # (G,)
    color: torch.Tensor  # (G, 3), or (T * G, 3) where the frames differ
    background: torch.Tensor  # (B, 3) over the window's pixels, repeated until T * h * w

    @property
    def frames(self) -> int:
        return self.mean.shape[0]

    @property
    def gaussians(self) -> int:
        return self.mean.shape[1]

    @property
    def total(self) -> int:
        """Gaussians of all frames."""
        return self.frames * self.gaussians

    @property
    def counts(self) -> tuple[int, int]:
        """Gaussians, rows of color."""
        return self.gaussians, self.color.shape[0]


@dataclass(frozen=True)
class Rendered:
    """Outputs, and what the way back needs beside them."""

    images: Tensors  # image (T, h, w, 3), alpha (T, h, w), mean depth (T, h, w) [m]
    kept: Tensors  # of the same shapes whenever the same is rendered: torch's checkpoints let go of them and compare
