"""The two unknown fields and their parameters (paper Eq. 1-2): material per part, force as footprint x amplitude per frame."""

from .force import FAMILIES, footprint_weights
from .parameters import Layout, Unknowns

__all__ = ["FAMILIES", "Layout", "Unknowns", "footprint_weights"]
