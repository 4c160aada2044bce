"""The outline of an untextured object followed through a clip: how far it lies along the normals of its first frame's points."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..inpaint import nearest_known
from ..picture import extent_px
from ..types import Clip, Tracks, object_mask
from .edges import Outline, coloured_outline, grey_of, outline_of

SPACING_PX = 6.0  # of points along the outline; neighbours nearer share the errors of an edge [chosen]
MOST_POINTS = 150  # along a third of the outline [numerical]
LEAST_POINTS = 8  # as of tracks [chosen]
ALONG = 0.6  # least cosine between a normal and the direction of motion: what slides along itself shows nothing [chosen]
FEW = 0.2  # of the points on an edge that can be seen [chosen]
FROM_CORNER = 0.1  # of the object's extent: nearer points leave their normals round the corner when the object swings [chosen]
REACH = 0.5  # of the object's extent that an edge is looked for on either side [chosen]
LEAST_REACH_PX, MOST_REACH_PX = 12.0, 60.0  # bounds of that [chosen]
LEAST_SHARE = 0.5  # of the received frames in which a point must be seen [chosen]
LEAST_CONTRAST = 8.0  # grey levels between inside and outside [chosen]
MOST_FAINT = 0.2  # share of an outline that may have less, before colours are looked at [chosen]
SMOOTH_MOTIONS = 3  # principal motions of an outline; what they leave is noise [chosen]
LEAST_SD_PX = 0.05  # of a point's edge: what sampling a blurred edge leaves [chosen]
WORST = 4.0  # times the usual spread beyond which a point's edge is none [chosen]
GROSS = 5.0  # standard deviations from the smooth motion beyond which an edge is another one [chosen]


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
    """The outline of a mask (H, W) in an RGB frame: of its grey levels, or of its colours where those leave much of it faint."""
    outline = outline_of(grey_of(frame), mask, _spacing(mask))
    faint = np.abs(outline.contrast) < LEAST_CONTRAST
    return coloured_outline(frame, mask, _spacing(mask)) if len(faint) and faint.mean() > MOST_FAINT else outline


def measured(clip: Clip, outline: Outline, reach_px: float) -> np.ndarray:
    """Signed distances (T, P) [px] of the observed outline along the normals of these points; NaN where none is seen."""
    found = [outline.distances(frame, reach_px) for frame in clip.frames]
    return np.where(clip.seen[:, None], np.array(found), np.nan)


def _spacing(mask: np.ndarray) -> float:
    return max(SPACING_PX, 3 * extent_px(mask) / MOST_POINTS)


def _reach(mask: np.ndarray) -> float:
    return float(np.clip(REACH * extent_px(mask), LEAST_REACH_PX, MOST_REACH_PX))


def _chosen(outline: Outline, labels: np.ndarray) -> Outline:
    """The points whose normals lie along the motion, away from corners, on an edge that can be seen; whatever their normals where that leaves only a
    few of an object that comes nearer or moves in several directions."""
    extent = extent_px(object_mask(labels[0]))
    direction = _direction(labels)
    kept = (outline.to_corner_px > FROM_CORNER * extent) & (np.abs(outline.contrast) > LEAST_CONTRAST)
    across = kept & (np.abs(outline.normals @ direction) > ALONG)
    return outline.only(across if across.sum() > FEW * kept.sum() else kept)


def _direction(labels: np.ndarray) -> np.ndarray:
    """Unit vector (2,) along which the object's centroid moves most."""
    inside = object_mask(labels)
    size = np.maximum(inside.sum((1, 2)), 1)
    centre = np.stack([(inside.sum(axis) @ np.arange(inside.shape[3 - axis])) / size for axis in (1, 2)], 1)
    return np.linalg.svd(centre - centre.mean(0), full_matrices=False)[2][0]


def _as_tracks(clip: Clip, outline: Outline, seen: np.ndarray, kept: np.ndarray, depth0: np.ndarray) -> Tracks:
    seen = seen[:, kept]
    sd_px = _spread(seen)
    seen = np.where(np.abs(seen - _smooth(seen)) <= GROSS * sd_px, seen, np.nan)
    seen[0] = np.nan_to_num(seen[0])
    valid, moved = np.isfinite(seen), np.nan_to_num(seen)
    moved = moved - moved[0]
    start, normals = outline.pixels[kept], outline.normals[kept]
    depth = nearest_known(depth0, depth0 > 0)[tuple(np.clip(np.rint(start[:, ::-1]).astype(int), 0, np.array(depth0.shape) - 1).T)].astype(float)
    pixels = start + moved[..., None] * normals
    points = clip.camera.backproject(pixels, np.broadcast_to(depth, moved.shape))
    step = clip.camera.backproject(start + normals, depth) - clip.camera.backproject(start, depth)
    size = np.linalg.norm(step, axis=1)
    sd = np.stack([np.where(valid, sd_px * size, np.inf), np.full(moved.shape, np.inf)], -1)
    sd[0] = 0.0
    noise = float(np.sqrt(np.mean((sd_px * size) ** 2)))
    return Tracks(pixels, points, valid, False, noise, sd, step / size[:, None])


def _smooth(seen: np.ndarray) -> np.ndarray:
    """The same distances (T, P) by their few principal motions, gaps filled by them."""
    rest = np.nanmedian(seen, 0)
    filled = np.where(np.isfinite(seen), seen - rest, 0.0)
    gaps = ~np.isfinite(seen)
    for _ in range(5):
        u, s, vt = np.linalg.svd(filled, full_matrices=False)
        smooth = (u[:, :SMOOTH_MOTIONS] * s[:SMOOTH_MOTIONS]) @ vt[:SMOOTH_MOTIONS]
        filled = np.where(gaps, smooth, filled)
    return smooth + rest


def _spread(seen: np.ndarray) -> np.ndarray:
    """Standard deviation (P,) [px] of each point's distances (T, P) about the smooth motion."""
    return np.maximum(1.4826 * np.nanmedian(np.abs(seen - _smooth(seen)), 0), LEAST_SD_PX)
