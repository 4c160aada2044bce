"""A still object seen from many sides: cameras and sparse points by structure from motion, metric scale, static Gaussians."""

from .folder import Capture, load
from .reconstruct import reconstruct

__all__ = ["Capture", "load", "reconstruct"]
