"""3D Gaussians: of frame 0, back-projected from depth and fitted; of many views; .ply in and out."""

from . import ply
from .ellipsoids import from_points
from .fit import fit_splats
from .multi_view import fit_views
from .view import Motion, View

__all__ = ["Motion", "View", "fit_splats", "fit_views", "from_points", "ply"]
