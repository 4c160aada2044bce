"""The motion of a few points, continued to the pixels around them."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import cKDTree

from ..matching import affine_fit
from .regions import pixel_grid

STEP_PX = 4  # distance of the pixels at which the motion is evaluated; bilinear between them
NEIGHBOURS = 8  # points that one pixel listens to
REACH_PX = 12.0  # within which they count alike; half the distance of the farthest of them where they lie apart
RIGIDITY_PX2 = 4.0  # added to the points' second moment: few points in a line move a pixel along with them, no more
AROUND_PX = 4  # beyond the pixels asked for


def interpolated_sources(now: np.ndarray, before: np.ndarray, near: np.ndarray) -> np.ndarray | None:
    """Where pixels came from: positions in frame 0, float32 (H, W, 2), by locally affine motion (moving least squares, Schaefer et
    al. 2006) of points now at `now` (M, 2) that were at `before` (M, 2) [px].

    Evaluated on and around the pixels `near` (H, W); pixels elsewhere come from far outside. None where fewer than 8 points are known.
    """
    if len(now) < NEIGHBOURS:
        return None
    height, width = near.shape
    rows, columns = (np.arange(-(-n // STEP_PX) + 1) * STEP_PX for n in (height, width))
    coarse = np.stack(np.meshgrid(columns, rows), -1).astype(float)
    wide = cv2.dilate(near.astype(np.uint8), np.ones((2 * AROUND_PX + 1,) * 2)) > 0
    motion = np.zeros_like(coarse)
    wanted = _touched(wide, coarse.shape[:2])
    motion[wanted] = affine_values(coarse[wanted], now.astype(float), (before - now).astype(float))
    grid = pixel_grid(near.shape)
    fine = cv2.remap(motion.astype(np.float32), grid[..., 0] / STEP_PX, grid[..., 1] / STEP_PX, cv2.INTER_LINEAR)
    return np.where(wide[..., None], grid + fine, np.float32(-2 * max(height, width)))


def _touched(wide: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Nodes (rows, columns) of the coarse grid with a wanted pixel within a step."""
    rows, columns = np.nonzero(wide)
    touched = np.zeros(shape, np.uint8)
    touched[rows // STEP_PX, columns // STEP_PX] = 1
    return cv2.dilate(touched, np.ones((2, 2)), anchor=(1, 1)) > 0


def affine_values(at: np.ndarray, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (N, C) at pixels (N, 2) of a weighted affine fit to the nearest of `points` (M, 2), M >= 8, with `values` (M, C)."""
    distance, index = cKDTree(points).query(at, k=NEIGHBOURS)
    weight = np.exp(-0.5 * (distance / np.maximum(REACH_PX, 0.5 * distance[:, -1:])) ** 2)
    weight /= weight.sum(1, keepdims=True)
    return affine_fit(at, points[index], values[index], weight, stiffness_px2=RIGIDITY_PX2)[0]
