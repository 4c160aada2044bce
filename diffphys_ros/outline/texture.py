"""Whether an object has texture enough for points on it to be followed."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..matching import Matching, normalised, seed_points, track_pixels
from ..types import Clip, object_mask

EDGE_PX, EDGE_SHARE = 7, 0.3  # from the object's border within which its edge passes for texture; of its half width, where it is narrow
TRIED, STRIDE = 12, 2  # frames in which points are looked for, and from one to the next
MOST_POINTS = 200
LEAST_SHARE = 0.9  # of them in which a point must be found
ENOUGH, ENOUGH_SHARE = 8, 0.25  # points that must be, as many as tracks need, and of those tried: chance finds some of a hundred on compressed film
INNER_SHARE = 0.5  # of the half width: so far inside, grey levels are looked at
FINE_PX, LEAST_GREY = 3.0, 1.5  # what is finer than this is texture, and its grey levels (root mean square): compressed film has .5 to .8 on a plain object


def has_texture(clip: Clip, first: int, settings: Settings) -> bool:
    """Whether points inside the object can be followed from frame `first` on. Needs `clip.labels`."""
    assert clip.labels is not None
    depth = cv2.distanceTransform(np.pad(object_mask(clip.labels[first]), 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    inside = depth > min(EDGE_PX, EDGE_SHARE * depth.max())
    grey = cv2.cvtColor(clip.frames[first], cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = (grey - cv2.GaussianBlur(grey, (0, 0), FINE_PX))[depth > INNER_SHARE * depth.max()]
    if not len(fine) or fine.std() < LEAST_GREY:
        return False
    frames = clip.frames[first :: STRIDE][:TRIED]
    images = [normalised(frame) for frame in frames]
    start = seed_points(images[0], inside, spacing_px=settings.experiment.track_spacing_px, most=MOST_POINTS)
    matching = Matching(settings.experiment.track_window_px, settings.experiment.track_round_trip_px)
    _, valid = track_pixels(images, start, np.ones(len(images), bool), matching)
    followed = valid.mean(0) >= LEAST_SHARE
    return bool(followed.sum() >= max(ENOUGH, ENOUGH_SHARE * len(start)))
