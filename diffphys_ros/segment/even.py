"""Labels of a plain object by its colours: optical flow has nothing to hold on to inside it, and calls what it uncovers the object."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ..inpaint import nearest_known
from ..types import IGNORE, object_mask
from .regions import disc, touching

SHADES = 8  # colours that a plain part shows: its faces turn in the light
SCENE = 24  # colours that are learnt of the scene
REACH = 0.5  # of the object's extent about it, within which it moves and the scene is learnt
SMOOTH_PX = 1.0  # of the frames, before colours are compared: noise
OPEN_PX = 1  # specks that are no object
SCENE_GREY = 10.0  # by which the scene may differ from frame 0 where it was seen there: colours (CIELAB) nearer to it are the scene
GROWTH = 0.35  # share of the object's area in frame 0 that another frame's may differ by: else colour does not tell it


def labels_by_colour(frames: np.ndarray, seen: np.ndarray, first: np.ndarray) -> np.ndarray | None:
    """Label images (T, H, W) uint8 from that of frame 0 (H, W), of frames (T, H, W, 3) RGB before a scene that stays; those not received (`seen`
    false) repeat the labels before them. None where the object has the scene's colours."""
    mask = object_mask(first)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((2 * max(round(REACH * _extent(mask)), 3) + 1,) * 2, np.uint8)) > 0
    begin = _lab(frames[0])
    parts = [int(p) for p in np.unique(first[mask])]
    inner = cv2.erode(mask.astype(np.uint8), disc(1)) > 0
    colours = [_palette(begin[inner & (first == p)], SHADES) for p in parts]
    scene = _palette(begin[near & ~mask & (first != IGNORE)], SCENE)
    if min(map(len, [*colours, scene])) == 0:
        return None
    own = cKDTree(np.concatenate(colours))
    owner, behind = np.repeat(parts, [len(c) for c in colours]), cKDTree(scene)
    labels = np.repeat(first[None], len(frames), 0)
    for k in range(1, len(frames)):
        if not seen[k]:
            labels[k] = labels[k - 1]
            continue
        shown = _lab(frames[k])
        distance, index = own.query(shown[near])
        apart = behind.query(shown[near])[0]
        known = ~mask[near] & (first[near] != IGNORE)  # the scene itself was seen there
        changed = np.linalg.norm(shown[near] - begin[near], axis=1)
        inside = np.zeros(mask.shape, bool)
        inside[near] = (distance < apart) & ~(known & (changed < np.minimum(SCENE_GREY, distance)))
        part_of = np.zeros(mask.shape, first.dtype)
        part_of[near] = owner[index]
        inside = _whole(inside, mask)
        if abs(int(inside.sum()) - int(mask.sum())) > GROWTH * mask.sum():
            return None
        labels[k] = np.where(inside, nearest_known(_settled(part_of, inside), inside), 0)
    return labels


def _extent(mask: np.ndarray) -> float:
    return float(np.linalg.norm([np.ptp(np.flatnonzero(mask.any(axis))) + 1.0 for axis in (0, 1)]))


def _lab(frame: np.ndarray) -> np.ndarray:
    """CIELAB (H, W, 3), float32, noise smoothed."""
    smooth = cv2.GaussianBlur(frame, (0, 0), SMOOTH_PX)
    return cv2.cvtColor(smooth.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)


def _palette(colours: np.ndarray, count: int) -> np.ndarray:
    """Colours (K, 3) that stand for many (N, 3)."""
    if len(colours) <= count:
        return colours
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 20, 0.5)
    few = colours[:: max(1, len(colours) // 4000)].astype(np.float32)
    return np.asarray(cv2.kmeans(few, count, None, criteria, 1, cv2.KMEANS_PP_CENTERS)[2])  # type: ignore[call-overload]


def _whole(inside: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The region (H, W) that holds most of where the object was in frame 0, without specks and holes."""
    opened = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_OPEN, disc(OPEN_PX))
    found = (touching(inside, mask) & (opened > 0)).astype(np.uint8)
    return cv2.morphologyEx(found, cv2.MORPH_CLOSE, disc(2 * OPEN_PX)) > 0


def _settled(part: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Part numbers without specks, (H, W)."""
    return np.where(inside, cv2.medianBlur(part.astype(np.uint8), 5), 0)
