"""The solid object: slab (from one view and a thickness). Reading order: frame, edges, silhouette, view, solid, slab. Needs OpenCV."""

from .leaving import line_sd_px, with_edge
from .slab import build_body

__all__ = ["build_body", "line_sd_px", "with_edge"]
