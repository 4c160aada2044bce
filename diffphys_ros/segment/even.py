"""Labels of a plain object by its colours: optical flow has nothing to hold on to inside it, and calls what it uncovers the object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ..inpaint import nearest_known
from ..picture import extent_px
from ..types import IGNORE, object_mask
from .regions import disc, touching

SHADES = 8  # colours that a plain part shows: its faces turn in the light [chosen]
SCENE = 24  # colours that are learnt of the scene [chosen]
REACH = 0.5  # of the object's extent about it, within which it moves and the scene is learnt [chosen]
SMOOTH_PX = 1.0  # of the frames, before colours are compared: noise [chosen]
OPEN_PX = 1  # specks that are no object [chosen]
GROWTH = 0.35  # share of the object's area in frame 0 that another frame's may differ by: else colour does not tell it [chosen]


@dataclass(frozen=True)
class Colours:
    """What frame 0 tells of an object's colours and the scene's."""

    first: np.ndarray  # labels of frame 0, (H, W)
    near: np.ndarray  # where the object may come, bool (H, W)
    shown: np.ndarray  # frame 0, CIELAB (H, W, 3)
    own: cKDTree  # colours of the object
    owner: np.ndarray  # their parts
    scene: cKDTree  # colours of the scene near by

    @classmethod
    def of(cls, frame: np.ndarray, first: np.ndarray) -> Colours | None:
        """Of an RGB frame (H, W, 3) and its labels (H, W); None where either side shows nothing."""
        mask, shown = object_mask(first), _lab(frame)
        side = 2 * max(round(REACH * extent_px(mask)), 3) + 1
        near = cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
        inner, parts = cv2.erode(mask.astype(np.uint8), disc(1)) > 0, np.unique(first[mask])
        own = [_palette(shown[inner & (first == part)], SHADES) for part in parts]
        scene = _palette(shown[near & ~mask & (first != IGNORE)], SCENE)
        if min(map(len, [*own, scene])) == 0:
            return None
        return cls(first, near, shown, cKDTree(np.concatenate(own)), np.repeat(parts, [len(each) for each in own]), cKDTree(scene))

    def labels(self, frame: np.ndarray) -> np.ndarray | None:
        """Labels (H, W) of another frame; None where that leaves too much or too little of the object."""
        mask, near, shown = object_mask(self.first), self.near, _lab(frame)
        distance, index = self.own.query(shown[near])
        known = ~mask[near] & (self.first[near] != IGNORE)  # the scene itself was seen there
        changed = np.linalg.norm(shown[near] - self.shown[near], axis=1)
        inside, part = np.zeros(mask.shape, bool), np.zeros(mask.shape, self.first.dtype)
        inside[near] = (distance < self.scene.query(shown[near])[0]) & ~(known & (changed < distance))
        part[near] = self.owner[index]
        inside = _whole(inside, mask)
        if abs(int(inside.sum()) - int(mask.sum())) > GROWTH * mask.sum():
            return None
        return np.where(inside, nearest_known(_settled(part, inside), inside), 0)


def labels_by_colour(frames: np.ndarray, seen: np.ndarray, first: np.ndarray) -> np.ndarray | None:
    """Label images (T, H, W) uint8 from that of frame 0 (H, W), of frames (T, H, W, 3) RGB before a scene that stays; those not received (`seen`
    false) repeat the labels before them. None where the object has the scene's colours."""
    colours = Colours.of(frames[0], first)
    if colours is None:
        return None
    labels = np.repeat(first[None], len(frames), 0)
    for k in range(1, len(frames)):
        found = colours.labels(frames[k]) if seen[k] else labels[k - 1]
        if found is None:
            return None
        labels[k] = found
    return labels


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
