"""An object that turns too far between two frames for its surface to be followed: where it is as a whole, by its mask and its depth."""

from __future__ import annotations

import numpy as np

from ..matching import normalised, seed_points
from ..types import Clip, Tracks, object_mask
from .follow import MOST_TRACKS

LEAST_PIXELS = 16  # of the mask with a depth, that tell where it is [numerical]


def carried(clip: Clip, depth0: np.ndarray, *, spacing_px: int) -> Tracks:
    """Surface points of frame 0 that go with the middle of what is seen of the object and do not turn: their standard deviation is what a turn may
    move them by, their distance from that middle. Needs `clip.labels` and `clip.depth`; `depth0` as in `follow`."""
    assert clip.labels is not None
    assert clip.depth is not None
    start = seed_points(normalised(clip.frames[0]), object_mask(clip.labels[0]) & (depth0 > 0), spacing_px=spacing_px, most=MOST_TRACKS)
    column, row = np.rint(start).astype(int).T
    points = clip.camera.backproject(start.astype(float), depth0[row, column].astype(float))
    middles = [_middle(clip, k) for k in range(len(clip))]
    shown = np.array([middle is not None for middle in middles]) & clip.seen
    moved = np.array([np.zeros(3) if middle is None or middles[0] is None else middle - middles[0] for middle in middles])
    path = points + moved[:, None]
    arm_m = float(np.sqrt(((points - points.mean(0)) ** 2).sum(1).mean() / 3))
    valid = np.repeat(shown[:, None], len(start), 1)
    sd = np.where(valid[..., None], arm_m, np.inf) * np.ones(2)
    sd[0] = 0.0
    return Tracks(clip.camera.project(path)[0], path, valid, True, arm_m, sd)


def _middle(clip: Clip, frame: int) -> np.ndarray | None:
    """World point (3,) [m]: median of the object's points in a frame; None where too few are seen."""
    assert clip.labels is not None
    assert clip.depth is not None
    row, column = np.nonzero(object_mask(clip.labels[frame]) & (clip.depth[frame] > 0))
    if len(row) < LEAST_PIXELS:
        return None
    return np.asarray(np.median(clip.camera.backproject(np.stack([column, row], -1).astype(float), clip.depth[frame][row, column].astype(float)), 0))
