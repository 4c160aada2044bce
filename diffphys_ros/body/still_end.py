"""Where an object meets what is still: the end of it that stays in its place whichever way it could move, as far as its masks show."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..mask_border import border, runs
from ..types import Clip, object_mask

STAYS_PX = 1.5  # within which an edge stays in its place [chosen]
MOST_FRAMES = 0.9  # of those that were received, in which it must [chosen]
SMOOTH_PX = 3.0  # standard deviation along the outline over which its direction is read [chosen]
LEAST_TURN = np.deg2rad(120.0)  # by which the outline turns along a held end: less, and it may slide along itself, as the middle of a free end does [chosen]
LEAST_SWING_PX = 4.5  # that some of the outline must be swept over by: of an object that hardly moves nothing is told [chosen]
MOST_STILL = 0.6  # of the outline that may be still [chosen]
LEAST_GAP_PX = 4  # shorter pieces of the outline that seem to move, or to stay, are noise [chosen]
FACING = 0.7  # cosine to the object's own direction from which a piece of the end faces what holds it [chosen]
HALF_PX = 0.5  # from a border pixel to the edge [derived]
LEAST_FACE_PX = 6  # of such pieces whose line is told from the object's direction else [chosen]


def still_end(clip: Clip) -> list[float] | None:
    """The line u v u v [px] across the one end of frame 0's object that stays in its place; None where there is none, or several. Needs `clip.labels`."""
    assert clip.labels is not None
    solid = object_mask(clip.labels[clip.seen])
    if len(solid) < 2 or not solid[0].any():
        return None
    path = border(solid[0])
    swept = _swept(solid, path)
    still = _tidied(swept <= STAYS_PX)
    if swept.max() < LEAST_SWING_PX or not still.any() or still.mean() > MOST_STILL:
        return None
    ends = [run for run in runs(still) if _turn(path, run) >= LEAST_TURN]
    if len(ends) != 1:
        return None
    line = _across(path[ends[0]], np.argwhere(solid[0])[:, ::-1].mean(0))
    return [float(v) for v in np.clip(np.round(line, 1), 0, np.array(solid.shape[:0:-1]) - 1).ravel()]


def _swept(solid: np.ndarray, path: np.ndarray) -> np.ndarray:
    """How far points of an outline (n, 2) lie from what as good as all masks (T, H, W) hold, or from what as good as none does, the further (n,) [px]."""
    share = solid.mean(0)
    always, never = (cv2.distanceTransform((~found).astype(np.uint8), cv2.DIST_L2, 3) for found in (share >= MOST_FRAMES, share <= 1 - MOST_FRAMES))
    return np.asarray(np.maximum(always, never)[path[:, 1], path[:, 0]])


def _tidied(still: np.ndarray) -> np.ndarray:
    """A closed row of flags (n,) without short pieces."""
    size = min(2 * LEAST_GAP_PX + 1, len(still))
    return np.asarray(np.convolve(np.concatenate([still[-LEAST_GAP_PX:], still, still[:LEAST_GAP_PX]]), np.ones(size), "valid") > size / 2)


def _turn(path: np.ndarray, run: np.ndarray) -> float:
    """Angle by which a closed outline (n, 2) turns along a piece of it."""
    smooth = gaussian_filter1d(path.astype(float), SMOOTH_PX, axis=0, mode="wrap")
    along = (np.roll(smooth, -1, 0) - np.roll(smooth, 1, 0))[run]
    direction = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    return float(np.ptp(direction)) if len(run) > 1 else 0.0


def _across(end: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """The line (2, 2) across an end (m, 2) of an object with its centroid at `centre` (2,), where it is furthest from there: along what faces away from
    the object, or at a right angle to the direction to it."""
    away = end.mean(0) - centre
    away /= np.linalg.norm(away)
    beside = np.array([-away[1], away[0]])
    smooth = gaussian_filter1d(end.astype(float), SMOOTH_PX, axis=0, mode="nearest")
    along = np.gradient(smooth, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    face = end[np.abs(along @ beside) > FACING]
    slope, last = 0.0, float((end @ away).max())
    if len(face) >= LEAST_FACE_PX and np.ptp(face @ beside) >= LEAST_FACE_PX:
        slope, last = np.polyfit(face @ beside, face @ away, 1)
        end = face
    sides = np.array([(end @ beside).min(), (end @ beside).max()])
    return np.asarray(sides[:, None] * beside + (last + HALF_PX + slope * sides)[:, None] * away)
