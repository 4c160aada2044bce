"""Metric depth of the object's surface in frame 0."""

from .capture import registered
from .scale import DepthSource
from .surface import SOURCES, source_of, surface_depth

__all__ = ["SOURCES", "DepthSource", "registered", "source_of", "surface_depth"]
