"""From the visible surface to a filled solid: body, particles, grid, and the skinning of points to particles."""

from __future__ import annotations

import numpy as np

from ..config import Settings
from ..types import Body, Clip
from .downsample import DensePoints, dense_points, downsample
from .fill import fill
from .grid import fit_grid, held_by, spacing_of_nodes
from .skinning import Binding, bind
from .splats import deform_splats

__all__ = [
    "Binding",
    "DensePoints",
    "bind",
    "build_body",
    "deform_splats",
    "dense_points",
    "downsample",
    "fill",
    "fit_grid",
    "held_by",
    "spacing_of_nodes",
]


def build_body(clip: Clip, depth0: np.ndarray, settings: Settings) -> Body:
    """The solid seen in frame 0; see body.build_body. Loaded late: a machine that only solves has no OpenCV."""
    from .body import build_body as build

    return build(clip, depth0, settings)
