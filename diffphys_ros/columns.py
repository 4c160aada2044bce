"""The solid of a slab from its silhouette alone: columns through its thickness.

A column is solid where all of it falls onto the object. Between two limbs that is so of more than the object: seen aslant, a side of one limb and the front
of the other fill the corner, and what is behind the one is before the other. This wedge ends where columns pass the corner of the silhouette; there the edges
of both limbs are continued straight, until they meet.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from .mask_border import runs

STEP_PX = 2.0  # between places at which a column is looked at [numerical]
LEAST_PX = 3.0  # shortest edge that is taken for a wedge's: what noise of the mask makes is shorter [chosen]
BESIDE_PX = 2.0  # of the limbs' edges next to a wedge's that their directions are not read from: corners are round [chosen]
ALONG = 0.5  # of a wedge's edge: how much of the limbs' edges their directions are read from [chosen]
FARTHEST = 2.0  # of a wedge's edge, from its ends: where the continued edges may meet [chosen]


def solid_columns(front: np.ndarray, back: np.ndarray, on_object: Callable[[np.ndarray], np.ndarray], cells_per_pixel: float) -> np.ndarray:
    """Columns (nx, ny) of a slab that are solid, by the pixels (nx, ny, 2) of their ends; `on_object` says of pixels (..., 2) whether they fall onto the object."""
    ends = on_object(front) & on_object(back)
    inside, depth = ends.copy(), back - front
    steps = int(np.ceil(np.linalg.norm(depth[ends], axis=1).max(initial=0.0) / STEP_PX))
    for share in np.arange(1, steps) / max(steps, 1):
        inside[inside] = on_object(front[inside] + share * depth[inside])
    return without_wedges(inside, ends & ~inside, cells_per_pixel)


def without_wedges(inside: np.ndarray, beyond: np.ndarray, cells_per_pixel: float) -> np.ndarray:
    """Columns `inside` (nx, ny) without what lies between the limbs: next to columns `beyond` (nx, ny), of which front and back alone fall onto the object."""
    size = max(round(LEAST_PX * cells_per_pixel), 2)
    kernel = np.ones((size, size), np.uint8)
    beyond = cv2.morphologyEx(beyond.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    if not beyond.any():
        return inside
    near = cv2.dilate(beyond, np.ones((2 * size + 1, 2 * size + 1), np.uint8)) > 0  # over what the steps make of the edge
    empty = np.zeros(inside.shape, np.uint8)
    for contour in cv2.findContours(inside.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
        points = contour[:, 0].astype(float)
        for run in runs(near[contour[:, 0, 1], contour[:, 0, 0]]):
            corner = _corner(points, run, BESIDE_PX * cells_per_pixel) if size <= len(run) < len(points) else None
            if corner is not None:
                cv2.fillPoly(empty, [np.rint(np.vstack([points[run], corner])).astype(np.int32)], 1)
    return inside & (empty == 0)


def _corner(points: np.ndarray, run: np.ndarray, beside: float) -> np.ndarray | None:
    """Where the edges on both sides of a run of a closed line, points (N, 2), meet if they go on straight, (2,); None where they do not, or far off."""
    length, skip = max(round(ALONG * len(run)), 3), round(beside)
    before = points[(run[0] - skip - np.arange(length)) % len(points)]
    after = points[(run[-1] + skip + np.arange(length)) % len(points)]
    (a, along), (b, back) = (_line(edge) for edge in (before, after))
    turn = np.stack([along, -back], 1)
    if abs(np.linalg.det(turn)) < 0.1:
        return None
    ways = np.linalg.solve(turn, b - a)
    span = float(np.linalg.norm(points[run[0]] - points[run[-1]]))
    corner = a + ways[0] * along
    far = max(float(np.linalg.norm(corner - points[end])) for end in (run[0], run[-1])) > FARTHEST * span
    return None if far or (ways < 0).any() else np.asarray(corner)


def _line(edge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle and direction, from its last point to its first, of the straight line through points (M, 2)."""
    middle = edge.mean(0)
    direction = np.linalg.svd(edge - middle)[2][0]
    return middle, direction * np.sign((edge[0] - edge[-1]) @ direction or 1.0)
