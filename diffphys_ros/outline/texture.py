"""Whether an object has texture enough for points on it to be followed."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..matching import Matching, normalised, seed_points, track_pixels
from ..types import Clip, object_mask

EDGE_PX = 7  # from the object's border within which its edge passes for texture
TRIED, STRIDE = 12, 2  # frames in which points are looked for, and from one to the next
MOST_POINTS = 200
ENOUGH, LEAST_SHARE = 24, 0.9  # points that must be found in so large a share of them: three times what tracks need at the least
FINE_PX, LEAST_GREY = 3.0, 1.5  # what is finer than this is texture, and its grey levels (root mean square): film compresses the finer ones away


def has_texture(clip: Clip, first: int, settings: Settings) -> bool:
    """Whether points inside the object can be followed from frame `first` on. Needs `clip.labels`."""
    assert clip.labels is not None
    inside = cv2.erode(object_mask(clip.labels[first]).astype(np.uint8), np.ones((2 * EDGE_PX + 1,) * 2)) > 0
    grey = cv2.cvtColor(clip.frames[first], cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = (grey - cv2.GaussianBlur(grey, (0, 0), FINE_PX))[inside]
    if not len(fine) or fine.std() < LEAST_GREY:
        return False
    frames = clip.frames[first :: STRIDE][:TRIED]
    images = [normalised(frame) for frame in frames]
    start = seed_points(images[0], inside, spacing_px=settings.experiment.track_spacing_px, most=MOST_POINTS)
    matching = Matching(settings.experiment.track_window_px, settings.experiment.track_round_trip_px)
    _, valid = track_pixels(images, start, np.ones(len(images), bool), matching)
    return int((valid.mean(0) >= LEAST_SHARE).sum()) >= ENOUGH
