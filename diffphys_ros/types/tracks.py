"""Points that are followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Tracks:
    """M surface points followed from frame 0."""

    pixels: np.ndarray  # [px], shape (T, M, 2)
    points: np.ndarray  # world [m], shape (T, M, 3); frame 0 is always finite
    valid: np.ndarray  # bool, shape (T, M); frame 0 is always true
    has_depth: bool  # whether motion along the line of sight was measured
    noise_m: float  # standard deviation of one coordinate of a displacement [m], estimated from the tracks
    sd_m: np.ndarray | None = None  # the same for every track and frame [m], shape (T, M, 2): of a coordinate across the line of sight,
    # and along it (infinite where that is not seen); 0 in frame 0, infinite where the track does not hold; None: not estimated
    normals: np.ndarray | None = None  # unit vectors, world, along which alone each point's motion is seen (it lies on the object's outline; see Camera.gradients), shape (M, 3); None: points
    first: np.ndarray | None = None  # where the points are in frame 0, world [m], shape (M, 3), where `points` lie on the body in a pose nearer to rest
    # than that of frame 0 and only their displacements are those of the frames; None: in frame 0, too
