"""The outline of an untextured object followed through a clip: how far it lies along the normals of its first frame's points."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..inpaint import nearest_known
from ..picture import extent_px
from ..types import Clip, Tracks, object_mask
from .edges import PLATEAU_PX, Outline, coloured_outline, grey_of, outline_of

SPACING_PX = 6.0  # of points along the outline; neighbours nearer share the errors of an edge [chosen]
MOST_POINTS = 150  # along a third of the outline [numerical]
LEAST_POINTS = 8  # as of tracks [chosen]
FROM_CORNER = 0.1  # of the object's extent: further off a corner no point leaves its normal round it when the object swings [chosen]
END_OVER_MIDDLE = 2.6  # how much further than its centroid the free end of a beam swings [derived: first mode of a clamped beam]
REACH = 0.5  # of the object's extent that an edge is looked for on either side [chosen]
LEAST_REACH_PX, MOST_REACH_PX = 12.0, 60.0  # bounds of that [chosen]
LEAST_SHARE = 0.5  # of the received frames in which a point must be seen [chosen]
LEAST_CONTRAST = 8.0  # grey levels between inside and outside [chosen]
LUMA_NOISE = 0.67  # of a grey level, over that of one channel, where the channels' noise is independent [derived: length of the luma's weights]
CLEARER = 1.5  # contrast over noise of an outline's colours over that of its grey levels, from which on colours are read: without hue it is 1.16 [chosen]
SMOOTH_MOTIONS = 3  # principal motions of an outline; what they leave is noise [chosen]
OWN = 3.0  # points, by participation, on which a principal motion is one of their edges alone: it is none of the outline [chosen]
LEAST_SD_PX = 0.05  # of a point's edge: what sampling a blurred edge leaves [chosen]
WORST = 4.0  # times the usual spread beyond which a point's edge is none [chosen]
GROSS, OTHER_PX = 5.0, 1.0  # standard deviations from the smooth motion beyond which an edge is another one, and how far it then lies off at the least [chosen]


def follow_outline(clip: Clip, depth0: np.ndarray) -> Tracks:
    """Tracks of points on the outline of frame 0 (see types.Tracks.normals). Needs `clip.labels` and the surface's depth [m] (H, W) in frame 0, 0
    off the object. Raises InputError where too little of the outline is seen to move across itself."""
    assert clip.labels is not None
    mask = object_mask(clip.labels[0])
    outline = _chosen(_outline(clip.frames[0], mask), clip.labels)
    seen = measured(clip, outline, _reach(mask))
    kept = np.isfinite(seen[0]) & (np.isfinite(seen[clip.seen]).mean(0) > LEAST_SHARE)
    if kept.any():
        spread = _spread(seen[:, kept])
        kept[kept] = spread <= WORST * np.median(spread)
    if kept.sum() < LEAST_POINTS:
        raise InputError(
            f"{clip.source or 'clip'}: {int(kept.sum())} points of the outline could be followed, at least {LEAST_POINTS} are needed; "
            "film the object larger, brighter and against a scene of another brightness"
        )
    return _as_tracks(clip, outline, seen, kept, depth0)


def _outline(frame: np.ndarray, mask: np.ndarray) -> Outline:
    """The outline of a mask (H, W) in an RGB frame: of its grey levels, or of its colours where these stand out of noise much better."""
    grey, coloured = outline_of(grey_of(frame), mask, _spacing(mask)), coloured_outline(frame, mask, _spacing(mask))
    if not len(grey.contrast) or not len(coloured.contrast):
        return grey
    clearer = LUMA_NOISE * np.median(np.abs(coloured.contrast)) > CLEARER * np.median(np.abs(grey.contrast))
    return coloured if clearer else grey


def measured(clip: Clip, outline: Outline, reach_px: float) -> np.ndarray:
    """Signed distances (T, P) [px] of the observed outline along the normals of these points; NaN where none is seen."""
    found = [outline.distances(frame, reach_px) for frame in clip.frames]
    return np.where(clip.seen[:, None], np.array(found), np.nan)


def _spacing(mask: np.ndarray) -> float:
    return max(SPACING_PX, 3 * extent_px(mask) / MOST_POINTS)


def _reach(mask: np.ndarray) -> float:
    return float(np.clip(REACH * extent_px(mask), LEAST_REACH_PX, MOST_REACH_PX))


def _chosen(outline: Outline, labels: np.ndarray) -> Outline:
    """The points on an edge that can be seen, so far away from corners that what slides along itself stays on its normals."""
    direction, swing_px = _swing(labels)
    along = np.abs(outline.normals @ direction)
    slides = PLATEAU_PX[1] + END_OVER_MIDDLE * swing_px * np.sqrt(1 - np.minimum(along, 1) ** 2)
    far = outline.to_corner_px > np.minimum(FROM_CORNER * extent_px(object_mask(labels[0])), slides)
    return outline.only(far & (np.abs(outline.contrast) > LEAST_CONTRAST))


def _swing(labels: np.ndarray) -> tuple[np.ndarray, float]:
    """Unit vector (2,) along which the object's centroid moves most, and how far it comes from where it is in frame 0 [px]."""
    inside = object_mask(labels)
    size = np.maximum(inside.sum((1, 2)), 1)
    centre = np.stack([(inside.sum(axis) @ np.arange(inside.shape[3 - axis])) / size for axis in (1, 2)], 1)
    moved = np.linalg.norm(centre - centre[0], axis=1)
    return np.linalg.svd(centre - centre.mean(0), full_matrices=False)[2][0], float(moved.max())


def _as_tracks(clip: Clip, outline: Outline, seen: np.ndarray, kept: np.ndarray, depth0: np.ndarray) -> Tracks:
    seen = seen[:, kept]
    sd_px = _spread(seen)
    seen = np.where(np.abs(seen - _smooth(seen)) <= np.maximum(GROSS * sd_px, OTHER_PX), seen, np.nan)
    seen[0] = np.nan_to_num(seen[0])
    valid, moved = np.isfinite(seen), np.nan_to_num(seen)
    moved = moved - moved[0]
    start, normals = outline.pixels[kept], outline.normals[kept]
    depth = nearest_known(depth0, depth0 > 0)[tuple(np.clip(np.rint(start[:, ::-1]).astype(int), 0, np.array(depth0.shape) - 1).T)].astype(float)
    pixels = start + moved[..., None] * normals
    points = clip.camera.backproject(pixels, np.broadcast_to(depth, moved.shape))
    gradient = clip.camera.gradients(points[0], normals)
    size = 1 / np.linalg.norm(gradient, axis=1)  # [m/px]
    sd = np.stack([np.where(valid, sd_px * size, np.inf), np.full(moved.shape, np.inf)], -1)
    sd[0] = 0.0
    noise = float(np.sqrt(np.mean((sd_px * size) ** 2)))
    return Tracks(pixels, points, valid, False, noise, sd, gradient * size[:, None])


def _smooth(seen: np.ndarray) -> np.ndarray:
    """The same distances (T, P) by their few principal motions, gaps filled by them."""
    rest = np.nanmedian(seen, 0)
    filled = np.where(np.isfinite(seen), seen - rest, 0.0)
    gaps = ~np.isfinite(seen)
    for _ in range(5):
        u, s, vt = np.linalg.svd(filled, full_matrices=False)
        shared = np.flatnonzero((vt**4).sum(1) < 1 / OWN)[:SMOOTH_MOTIONS]
        leading = (u[:, shared] * s[shared]) @ vt[shared]
        filled = np.where(gaps, leading, filled)
    return leading + rest


def _spread(seen: np.ndarray) -> np.ndarray:
    """Standard deviation (P,) [px] of each point's distances (T, P) about the smooth motion."""
    return np.maximum(1.4826 * np.nanmedian(np.abs(seen - _smooth(seen)), 0), LEAST_SD_PX)
