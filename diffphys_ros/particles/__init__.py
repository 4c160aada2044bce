"""From the visible surface to a filled solid: body, particles, grid, and the skinning of points to particles."""

from .body import build_body
from .fill import fill
from .grid import fit_grid
from .skinning import Binding, bind
from .splats import deform_splats

__all__ = ["Binding", "bind", "build_body", "deform_splats", "fill", "fit_grid"]
