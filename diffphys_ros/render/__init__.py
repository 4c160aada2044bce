"""A differentiable renderer of 3D Gaussians in NVIDIA Warp, for CPU and CUDA."""

from .rasterizer import Rasterizer
from .view import Window, full_window, window_around

__all__ = ["Rasterizer", "Window", "full_window", "window_around"]
