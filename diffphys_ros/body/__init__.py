"""The solid object: slab (from one view and a thickness). Reading order: frame, edges, silhouette, view, solid, slab. Needs OpenCV."""

from .slab import build_body

__all__ = ["build_body"]
