"""Which frame shows the object nearest to rest, and tracks that count from its pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..types import Tracks

LEAST_SEEN = 0.5  # of the points, that must hold in a frame at which a body is built [chosen]
NEARER = 0.5  # times as far from the mean pose as frame 0: else nothing is gained by another frame [chosen]


def frame_of_rest(tracks: Tracks) -> int:
    """The frame nearest to the pose about which the second half of the clip swings, where frame 0 lies further from it than those frames
    usually do: a clip that begins in motion. Else 0."""
    half = len(tracks.points) // 2
    moved = np.where(tracks.valid[..., None], tracks.points - tracks.points[:1], np.nan)
    often = tracks.valid[half:].mean(0) > LEAST_SEEN
    if not often.any():
        return 0
    off = moved[:, often] - np.nanmean(moved[half:, often], 0)
    held = tracks.valid[:, often].sum(1)
    distance = np.sqrt(np.nansum(off**2, (1, 2)) / np.maximum(held, 1))
    distance[held < LEAST_SEEN * often.sum()] = np.inf
    nearest = half + int(distance[half:].argmin())
    usual = np.sqrt(np.mean(distance[half:][np.isfinite(distance[half:])] ** 2))
    return nearest if distance[0] > usual and distance[nearest] < NEARER * distance[0] else 0


def counted_from(tracks: Tracks, frame: int) -> Tracks:
    """The points that hold in a frame, in whose pose they lie on the body; how they move from frame 0 on stays."""
    kept = tracks.valid[frame]
    pixels, points, valid = (array[:, kept] for array in (tracks.pixels, tracks.points, tracks.valid))
    sd = None if tracks.sd_m is None else tracks.sd_m[:, kept]
    return replace(tracks, pixels=pixels, points=points + (points[frame] - points[0]), valid=valid, sd_m=sd, first=points[0])
