"""Static 3D Gaussians of frame 0: back-project, fit with pruning and splitting, .ply in and out."""

from . import ply
from .fit import fit_splats

__all__ = ["fit_splats", "ply"]
