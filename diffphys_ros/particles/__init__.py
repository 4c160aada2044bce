"""A body as particles: fill or downsample, the grid around them, skinning of points to them, Gaussians that they carry."""

from __future__ import annotations

from .carry import deform_splats
from .downsample import DensePoints, dense_points, downsample
from .fill import fill
from .grid import fit_grid, held_by, spacing_of_nodes
from .skinning import Binding, bind

__all__ = [
    "Binding",
    "DensePoints",
    "bind",
    "deform_splats",
    "dense_points",
    "downsample",
    "fill",
    "fit_grid",
    "held_by",
    "spacing_of_nodes",
]
