"""What fixes the metric scale of a depth that has none."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..config import Settings
from ..picture import length_at_unit_depth
from ..types import Camera, Clip

ASSUMED_DISTANCE_M = 1.0
UNKNOWN = f"unknown: the object is assumed {ASSUMED_DISTANCE_M:g} m away"

DEPTH_TOPIC = "depth topic"
CLAMP = "clamp_box_m and the camera's pose"


@dataclass(frozen=True)
class DepthSource:
    """Where a depth comes from, in words."""

    surface: str
    scale: str  # what fixed its metric scale

    @property
    def words(self) -> str:
        """Both in a phrase."""
        return self.surface if self.surface == self.scale else f"{self.surface}; scale: {self.scale}"


def on_clamp(clip: Clip, settings: Settings) -> bool:
    """Whether clamp box, thickness axis and the camera's pose say where the object is."""
    scene = settings.scene
    return scene.clamp_box_m is not None and scene.thickness_axis is not None and clip.camera.pose_known


def object_distance(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[float, str]:
    """Depth of the object's front as one number [m], and what fixed it: the clamp, the known size, or nothing."""
    scene = settings.scene
    if scene.clamp_box_m is not None and on_clamp(clip, settings):
        centre = np.reshape(scene.clamp_box_m, (2, 3)).mean(0)
        return float(clip.camera.project(centre)[1]) - (scene.thickness_m or 0.0) / 2, CLAMP
    if scene.size_m is None or not mask.any():
        return ASSUMED_DISTANCE_M, UNKNOWN
    if scene.length_px is not None:
        return scene.size_m / length_at_unit_depth(clip.camera, scene.length_px), f"size_m {scene.size_m:g} m between the points of length_px"
    return scene.size_m / _extent_at_unit_depth(clip.camera, mask), f"size_m {scene.size_m:g} m, taken across the line of sight"


def _extent_at_unit_depth(camera: Camera, mask: np.ndarray) -> float:
    """Largest distance between two points of the silhouette on the plane at unit depth."""
    v, u = np.nonzero(mask)
    corners = np.concatenate([np.stack([u + du, v + dv], -1) for du in (-0.5, 0.5) for dv in (-0.5, 0.5)]).astype(np.float32)
    hull = cv2.convexHull(corners)[:, 0].astype(float)
    at = (camera.rays(hull) @ camera.world_from_camera[:3, :3])[:, :2]
    return float(np.linalg.norm(at[:, None] - at[None], axis=-1).max())
