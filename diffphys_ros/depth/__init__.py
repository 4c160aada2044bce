"""Metric depth of the object's surface in frame 0."""

from .surface import SOURCES, surface_depth

__all__ = ["SOURCES", "surface_depth"]
