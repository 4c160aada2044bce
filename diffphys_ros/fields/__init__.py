"""The two unknown fields and their parameters (paper Eq. 1-2): material per part, force as footprint x amplitude per frame."""

from .parameters import Layout, Unknowns

__all__ = ["Layout", "Unknowns"]
