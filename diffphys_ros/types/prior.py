"""What is believed of the material."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .camera import Camera


@dataclass(frozen=True)
class MaterialPrior:
    """What is believed of the material before any motion is looked at: K materials and where each lies in frame 0."""

    index: np.ndarray  # material of every pixel, off the object that of the nearest pixel on it; 0..K-1, int16, shape (H, W)
    name: tuple[str, ...]  # K names
    young: np.ndarray  # [Pa], shape (K,)
    log10_young_sd: np.ndarray  # shape (K,)
    poisson: np.ndarray  # shape (K,)
    density: np.ndarray  # [kg/m^3], shape (K,)
    source: str  # who says so, in words
    notes: tuple[str, ...] = ()  # what was assumed, one sentence each

    def at(self, camera: Camera, points: np.ndarray) -> np.ndarray:
        """Materials 0..K-1 (...) at world points (..., 3) [m] of frame 0, by the pixel that they project to."""
        pixels = np.rint(camera.project(points)[0])
        u, v = (np.clip(pixels[..., i], 0, self.index.shape[1 - i] - 1).astype(int) for i in (0, 1))
        return self.index[v, u].astype(int)
