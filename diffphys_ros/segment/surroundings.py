"""How far an object may reach beyond what moves of it: to the next step in depth, to its clamp."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..config import Settings
from ..inpaint import nearest_known
from ..types import Clip
from .regions import disc, pixel_grid

STEP = 0.02  # change of depth from one pixel to the next, as a share of the depth, at which a surface ends
LEAST_SHARE = 0.5  # of the moving pixels that the surface must hold; less, and depth says nothing about the object
OTHER_SHARE = 0.1  # of the largest surface's moving pixels that another surface of the object must hold
RIM_PX = 2  # along an edge, within which a depth may be the neighbouring surface's
OTHER_MOVING = 0.3  # of its own pixels that must move: of a wall behind, the core's rim is a sliver


def reachable(clip: Clip, core: np.ndarray, settings: Settings) -> np.ndarray:
    """Pixels that may be the object that `core` (H, W) is the moving part of, bool (H, W): all without a depth topic, else those that
    join it without a step in depth and lie before the clamped face where `scene.clamp_box_m` gives one."""
    if clip.depth is None:
        return np.ones(core.shape, bool)
    depth = _without_holes(clip.depth[0])
    surface = _joined(depth, core)
    if (surface & core).sum() < LEAST_SHARE * core.sum():
        return np.ones(core.shape, bool)
    return core | (surface & _before_clamp(clip, depth, core, settings))


def _without_holes(depth: np.ndarray) -> np.ndarray:
    if not (depth > 0).any():
        return np.ones_like(depth)
    return nearest_known(depth, depth > 0)


def _joined(depth: np.ndarray, core: np.ndarray) -> np.ndarray:
    """The surface without inner steps that holds most of the core, and others that are large and mostly core themselves, bool (H, W)."""
    node = np.arange(depth.size).reshape(depth.shape)
    rows, columns = [], []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        smooth = np.abs(depth[a] - depth[b]) < STEP * np.minimum(depth[a], depth[b])
        rows.append(node[a][smooth])
        columns.append(node[b][smooth])
    row, column = np.concatenate(rows), np.concatenate(columns)
    graph = coo_matrix((np.ones(len(row), bool), (row, column)), shape=(depth.size, depth.size))
    surface = connected_components(graph, directed=False)[1].reshape(depth.shape)
    moving, size = (np.bincount(surface[pixels], minlength=int(surface.max()) + 1) for pixels in (core, np.ones_like(core)))
    return ((moving == moving.max()) | ((moving > OTHER_SHARE * moving.max()) & (moving > OTHER_MOVING * size)))[surface]


def _before_clamp(clip: Clip, depth: np.ndarray, core: np.ndarray, settings: Settings) -> np.ndarray:
    """Pixels whose surface lies on the moving side of the clamped face and, near its plane, not beside it, where the mount's own front may
    be flush: bool (H, W); all where no clamp or no pose is known."""
    box = settings.scene.clamp_box_m
    if box is None or not clip.camera.pose_known:
        return np.ones(depth.shape, bool)
    low, high = np.reshape(box, (2, 3))
    axis = int(np.argmin(high - low))  # across the face the box is thinnest
    slack = (high - low)[axis] / 2
    points = clip.camera.backproject(pixel_grid(depth.shape).astype(float), depth.astype(float))
    beyond = points[..., axis] - (low + high)[axis] / 2
    beyond *= np.sign(np.median(beyond[core]))
    beside = np.delete((points < low - slack) | (points > high + slack), axis, -1).any(-1) & (beyond < slack)
    solid = cv2.morphologyEx(beside.astype(np.uint8), cv2.MORPH_OPEN, disc(RIM_PX)) > 0
    return (beyond > -slack) & ~solid


def ends_inside(clip: Clip, within: np.ndarray, settings: Settings) -> np.ndarray:
    """Measured pixels of a reachable surface `within` (H, W) that ends inside the picture all around, by steps in depth and by its clamp:
    bool (H, W); none without a clamp, and none of a floor or wall that goes on beyond the picture."""
    rim = np.ones(within.shape, bool)
    rim[1:-1, 1:-1] = False
    if clip.depth is None or settings.scene.clamp_box_m is None or (within & rim).any():
        return np.zeros(within.shape, bool)
    return within & (clip.depth[0] > 0)
