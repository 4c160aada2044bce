"""Surface depth as one plane across the line of sight: for flat objects filmed squarely."""

from __future__ import annotations

import numpy as np

from ..config import Settings
from ..types import Clip
from .scale import DepthSource, object_distance


def flat_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels: where the clamp or `scene.size_m` puts it, one metre away
    where neither is known."""
    distance, scale = object_distance(clip, mask, settings)
    return np.where(mask, distance, 0.0).astype(np.float32), DepthSource("a plane across the line of sight", scale)
