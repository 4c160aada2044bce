"""The shape about which an object swings where frame 0 shows another, and the frame nearest to it. numpy and scipy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Tracks
from .coordinates import leading, shapes_of
from .forced_frames import find_support

LEAST_SEEN = 0.5  # of the points, that must hold in a frame at which a body is built [chosen]
AWAY = 0.1  # of the motion, that frame 0 lies from the centre of a free swing if it is not its shape at rest [chosen]
USUAL = 1.0  # of the motion: the same where no free swing tells the centre and the mean shape of the second half stands for it [chosen]


@dataclass(frozen=True)
class Rest:
    """A clip that begins in motion."""

    frame: int  # nearest to rest
    offset: np.ndarray  # from where that frame has a point to where it rests [m], world, of the points that hold in it, (M', 3)


def rest_of(tracks: Tracks, period_s: float) -> Rest | None:
    """The shape about which the free motion of tracks with depth swings, else that about which the second half of the clip does; None where it
    is that of frame 0 as far as this can be told."""
    displacement = np.where(tracks.valid[..., None], tracks.points - tracks.points[:1], 0.0)
    q, known = leading(tracks.points[0], displacement, tracks.valid, tracks.noise_m)
    support = find_support(q, known, period_s, at_rest=False, noise_m=tracks.noise_m)
    free = support.centre if support.has_free_tail else None
    late = known & (np.arange(len(q)) >= len(q) // 2)
    centre = q[late].mean(0) if free is None else free
    distance = np.linalg.norm(q - centre, axis=1)
    if distance[0] <= (USUAL if free is None else AWAY) * np.sqrt(np.mean(distance[late] ** 2)):
        return None
    distance[tracks.valid.mean(1) < LEAST_SEEN] = np.inf
    frame = int(distance.argmin())
    shapes, _ = shapes_of(q, displacement, tracks.valid, -centre)
    return Rest(frame, shapes[tracks.valid[frame]] @ (centre - q[frame]))
