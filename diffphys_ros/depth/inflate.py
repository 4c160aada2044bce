"""Surface depth without a depth topic: the object's front plane, where what is known of the scene puts it."""

from __future__ import annotations

import numpy as np

from ..config import Settings
from ..types import Clip

ASSUMED_DISTANCE_M = 1.0


def inflated_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, str]:
    """Depth [m] (H, W) at which the rays of the object's pixels meet its front plane, and where that plane comes from.

    Metric where clamp box, thickness axis and the camera's pose are known: the plane across the axis, half a thickness in front of
    the box's centre. Otherwise a plane one metre away, across the optical axis: everything metric is then assumed.
    """
    scene, camera = settings.scene, clip.camera
    if scene.clamp_box_m is None or scene.thickness_axis is None or not camera.pose_known:
        return np.where(mask, ASSUMED_DISTANCE_M, 0.0).astype(np.float32), f"assumed: a plane {ASSUMED_DISTANCE_M:g} m away"
    centre = np.reshape(scene.clamp_box_m, (2, 3)).mean(0)
    axis = np.array(scene.thickness_axis, float) / np.linalg.norm(scene.thickness_axis)
    normal = axis * np.sign((camera.position - centre) @ axis)
    front = centre + normal * (scene.thickness_m or 0.0) / 2
    pixels = np.stack(np.meshgrid(np.arange(mask.shape[1]), np.arange(mask.shape[0])), -1).astype(float)
    slope = camera.rays(pixels) @ normal
    depth = ((front - camera.position) @ normal) / np.where(slope < -1e-3, slope, -np.inf)
    return np.where(mask & (depth > 0), depth, 0.0).astype(np.float32), "inflated from the silhouette on the clamp's plane"
