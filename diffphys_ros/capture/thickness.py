"""How thick the object is, where pictures show its back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..types import Camera

LEAST_POINTS = 12  # of the object, each on the front and on the back
BEHIND = -0.2  # cosine between the axis towards the clip's camera and the line to a camera that looks at the back
BEFORE = 0.2
OUTER = 0.9  # quantile of the heights that counts as the level of a face: specks in front of it do not


def thickness_along(
    axis: np.ndarray, points: np.ndarray, surface: np.ndarray, seen_by: Sequence[np.ndarray], cameras: Sequence[Camera], clip_camera: Camera
) -> tuple[float, str]:
    """Largest extent [m] of the object along a world axis (3,), and how it is known; NaN where the pictures do not tell.

    Args:
        points: of the object, perhaps with some of the scene behind it [m], shape (N, 3).
        surface: which of them hang together with what frame 0 shows of the object, bool (N,).
        seen_by: per camera which points it shows, bool (N,). The front's level comes from points of the surface that cameras before it
            show, the back's from points that cameras behind it show and none before it: those of the scene behind are seen from before.
        cameras: that took the pictures. clip_camera: that of the clip, which says where the front is.
    """
    middle = np.median(points[surface], 0) if surface.any() else np.zeros(3)
    unit = axis / np.linalg.norm(axis)
    unit = unit * np.sign((clip_camera.position - middle) @ unit or 1.0)
    towards = np.array([camera.position for camera in cameras]) - middle
    cosine = towards @ unit / np.linalg.norm(towards, axis=1)
    before, behind = (_shown(seen_by, chosen, len(points)) for chosen in (cosine > BEFORE, cosine < BEHIND))
    front, back = surface & before, behind & ~before
    if min(front.sum(), back.sum()) < LEAST_POINTS:
        return np.nan, f"thickness not measured: {int(back.sum())} points of the object are seen from behind, {LEAST_POINTS} are needed"
    height = points @ unit
    extent = float(np.quantile(height[front], OUTER) - np.quantile(height[back], 1 - OUTER))
    return extent, f"thickness {1e3 * extent:.3g} mm from {int(front.sum())} points seen from before and {int(back.sum())} seen from behind"


def _shown(seen_by: Sequence[np.ndarray], chosen: np.ndarray, count: int) -> np.ndarray:
    """Points (N,) that one of the chosen cameras shows."""
    shown = np.zeros(count, bool)
    for k in np.flatnonzero(chosen).tolist():
        shown |= seen_by[k]
    return shown
