"""Where the body is in frame 0, if it was built in a pose nearer to rest."""

from __future__ import annotations

import numpy as np

from ..particles.skinning import bind
from ..types import Tracks


def in_body_pose(tracks: Tracks, points: np.ndarray) -> np.ndarray:
    """World points (N, 3) [m] of frame 0 where they are in the pose in which the body was built."""
    if tracks.first is None or not len(points):
        return points
    return points + bind(points, tracks.first).apply(tracks.points[0] - tracks.first)


def offset_of_first(tracks: Tracks, points: np.ndarray) -> np.ndarray:
    """From world points (N, 3) [m] of the pose in which the body was built to where these are in frame 0 [m], (N, 3)."""
    if tracks.first is None:
        return np.zeros_like(points)
    return bind(points, tracks.points[0]).apply(tracks.first - tracks.points[0])
