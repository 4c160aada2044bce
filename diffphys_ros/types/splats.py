"""What a view is rendered from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Splats:
    """3D Gaussians of the object in frame 0, world frame."""

    mean: np.ndarray  # [m], float32, shape (G, 3)
    rotation: np.ndarray  # unit quaternion wxyz, float32, shape (G, 4)
    scale: np.ndarray  # standard deviations [m], float32, shape (G, 3)
    opacity: np.ndarray  # 0..1, float32, shape (G,)
    color: np.ndarray  # RGB 0..1, float32, shape (G, 3)
