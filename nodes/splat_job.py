"""The fit of Gaussians as it runs in a process of its own, which takes its memory along: it needs no ROS."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

from diffphys_ros.config import Settings
from diffphys_ros.types import Camera, Clip, Splats


def fit(clip: Clip, settings: Settings) -> Generator[Any, None, tuple[Splats, Camera]]:
    """News, then the Gaussians of frame 0 and the camera that sees them."""
    from diffphys_ros.depth import placed, surface_depth
    from diffphys_ros.inverse import fit_gaussians

    clip = placed(clip, settings)
    depth0, _ = surface_depth(clip, settings)
    return (yield from fit_gaussians(clip, depth0, settings)), clip.camera
