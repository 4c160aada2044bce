"""The solid object: slab (from one view and a thickness). Reading order: frame, edges, silhouette, view, solid, slab. Needs OpenCV."""

from .leaving import cut_off_at, line_sd_px, with_edge
from .slab import build_body

__all__ = ["build_body", "cut_off_at", "line_sd_px", "with_edge"]
