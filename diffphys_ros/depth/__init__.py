"""Metric depth of the object's surface in frame 0."""

from .capture import registered
from .scale import DepthSource
from .surface import SOURCES, placed, source_of, surface_depth

__all__ = ["SOURCES", "DepthSource", "placed", "registered", "source_of", "surface_depth"]
