"""Metric depth of the object's surface in frame 0."""

from .scale import DepthSource
from .surface import SOURCES, surface_depth

__all__ = ["SOURCES", "DepthSource", "surface_depth"]
