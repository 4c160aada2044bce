"""The outline of the body seen along its thickness, to a fraction of a pixel, and the height of its front."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import binary_fill_holes, label, median_filter

from ..columns import solid_columns
from ..inpaint import nearest_known
from ..types import Camera

CELLS_PER_PIXEL = 3.0  # raster cells across the footprint of a pixel
FIXED_POINT_STEPS = 12  # of the search for the surface above a raster cell
GAP_PX = 3.0  # width of a hole from which it is a gap between strands: narrower ones are the mask's own noise
END_ARM_PX = 3.0  # over which the direction of its border is read [chosen]
OFF_SURFACE = 0.25  # of a pixel's footprint: a cell whose own ray ends further to the side is not under the surface


@dataclass(frozen=True)
class Raster:
    """Square cells in the body's x-y plane. Cell (i, j) has its centre at origin + pitch * (i, j); edges lie on x = 0."""

    origin: np.ndarray  # [m], shape (2,)
    pitch_m: float
    shape: tuple[int, int]

    @property
    def centres(self) -> np.ndarray:
        """Body x and y of the cell centres [m], shape (nx, ny, 2)."""
        index = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), -1)
        return self.origin + self.pitch_m * index


def raster_over(points: np.ndarray, pitch_m: float, *, from_zero: bool, beside_m: float = 0.0) -> Raster:
    """The raster that covers body points (P, 2 or 3) with a margin, and so much more to either side, starting at x = 0 where the body is clamped there."""
    margin = 6 * pitch_m + np.array([0.0, beside_m])
    low = np.floor((points[:, :2].min(0) - margin) / pitch_m)
    high = np.ceil((points[:, :2].max(0) + margin) / pitch_m)
    if from_zero:
        low[0] = 0
    return Raster((low + 0.5) * pitch_m, pitch_m, tuple((high - low).astype(int)))


def projected(raster: Raster, pose: np.ndarray, camera: Camera, height: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (nx, ny, 2) and depths (nx, ny) [m] of the raster's cells at a height (nx, ny) or one for all [m]; `pose` is world_from_body (4, 4)."""
    cells = np.concatenate([raster.centres, np.broadcast_to(height, raster.shape)[..., None]], -1)
    return camera.project(cells @ pose[:3, :3].T + pose[:3, 3])


def sample(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Bilinear values of an image (H, W) at pixel positions (..., 2); 0 outside."""
    last = np.array(image.shape[::-1]) - 2
    corner = np.clip(np.floor(pixels), 0, last).astype(int)
    inside = ((pixels >= 0) & (pixels <= last + 1)).all(-1)
    a, b = np.moveaxis(pixels - corner, -1, 0)
    at = corner[..., 1] * image.shape[1] + corner[..., 0]
    flat, below = image.ravel(), image.shape[1]
    upper = flat[at] * (1 - a) + flat[at + 1] * a
    lower = flat[at + below] * (1 - a) + flat[at + below + 1] * a
    return np.where(inside, upper * (1 - b) + lower * b, 0.0)


def surface_height(raster: Raster, pose: np.ndarray, camera: Camera, soft: np.ndarray, depth: np.ndarray, start: float, footprint_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Height of the visible surface above every raster cell, and which cells lie under it.

    Fixed point: a cell's point at the present height is projected into the image, the depth there puts a hit on that ray, and the
    hit's height is the next guess. A cell beyond an edge of the front sees the side face behind it, so its guess sinks step by
    step until the ray misses the object: the outline of the front comes out without being drawn.

    Args:
        raster: cells in the body's x-y plane.
        pose: world_from_body (4, 4); z = 0 may lie anywhere.
        camera: of the image.
        soft: share of each pixel that the object covers (H, W); the edge is where it passes a half.
        depth: of the object's surface [m], 0 off the object (H, W).
        start: first guess of the height, that of the front [m].
        footprint_m: side of a pixel on the object [m].

    Returns:
        height [m] (nx, ny), inside bool (nx, ny).
    """
    inverse = _extended_inverse(depth)
    cells = raster.centres.reshape(-1, 2)
    height, inside = np.full(len(cells), start), np.zeros(len(cells), bool)
    alive = np.arange(len(cells))
    miss = np.full(len(cells), np.inf)
    for _ in range(FIXED_POINT_STEPS):
        points = np.concatenate([cells[alive], height[alive, None]], -1) @ pose[:3, :3].T + pose[:3, 3]
        pixels, _ = camera.project(points)
        seen = sample(soft, pixels) >= 0.5
        alive, pixels = alive[seen], pixels[seen]
        hits = (camera.backproject(pixels, 1 / np.maximum(sample(inverse, pixels), 1e-6)) - pose[:3, 3]) @ pose[:3, :3]
        miss[alive] = np.linalg.norm(hits[:, :2] - cells[alive], axis=-1)
        height[alive] = hits[:, 2]
    inside[alive] = miss[alive] < OFF_SURFACE * footprint_m
    return height.reshape(raster.shape), inside.reshape(raster.shape)


def carved(raster: Raster, pose: np.ndarray, camera: Camera, soft: np.ndarray, heights: tuple[float, float]) -> np.ndarray:
    """Cells (nx, ny) of a slab between two heights [m], front and back, by its silhouette alone (`soft`, see above)."""
    front, back = (projected(raster, pose, camera, height)[0] for height in heights)
    return solid_columns(front, back, lambda pixels: sample(soft, pixels) >= 0.5, CELLS_PER_PIXEL)


def tidy(inside: np.ndarray, gaps: np.ndarray | None = None) -> np.ndarray:
    """One region without slits and hairs of a cell's width, and without holes, but for those that a disc of GAP_PX fits into where the scene is seen
    through them, `gaps` (nx, ny); None: nowhere."""
    kernel = np.ones((3, 3), np.uint8)
    closed = cv2.morphologyEx(np.pad(inside, 3).astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    opened = cv2.morphologyEx(closed, cv2.MORPH_OPEN, kernel)[3:-3, 3:-3] > 0
    whole = binary_fill_holes(opened)
    regions, count = label(whole if gaps is None else whole & ~_wide_holes(whole & ~opened, gaps))
    return regions == 1 + np.argmax(np.bincount(regions.ravel())[1:]) if count else opened


def _wide_holes(holes: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Holes (nx, ny), whole, in which a disc of GAP_PX lies in the gaps (nx, ny)."""
    side = round(GAP_PX * CELLS_PER_PIXEL)
    wide = cv2.erode((holes & gaps).astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))) > 0
    number, _ = label(holes)
    return holes & np.isin(number, np.unique(number[wide]))


def reaching_clamp(inside: np.ndarray, hidden: np.ndarray, *, reach: int, tolerance: int) -> np.ndarray:
    """The silhouette continued to x = 0 where something in front hides its root.

    Args:
        inside: silhouette (nx, ny), x = 0 at the first row's lower edge.
        hidden: cells (nx, ny) at which the body cannot be seen.
        reach: longest gap that is closed [cells].
        tolerance: gap that is closed even where nothing hides it [cells].
    """
    filled = inside.copy()
    start = np.where(inside.any(0), np.argmax(inside, axis=0), len(inside))
    for j in np.flatnonzero(start <= reach):
        gap = hidden[: start[j], j]
        if (~gap).sum() <= tolerance:
            filled[: start[j], j] = True
    return filled


def ending(inside: np.ndarray) -> np.ndarray:
    """Columns (ny,) in which the silhouette (nx, ny) has its end towards x = 0: its border there lies rather along y than along x, which its sides do
    not, and no step lies between it and where the silhouette is nearest to x = 0, as before the shoulders of a leaf on a stem."""
    start = np.where(inside.any(0), np.argmax(inside, axis=0), len(inside))
    arm = round(END_ARM_PX * CELLS_PER_PIXEL)
    beside = np.pad(start, arm, mode="edge")
    level = np.minimum(np.abs(beside[: -2 * arm] - start), np.abs(beside[2 * arm :] - start)) <= arm
    run = np.cumsum(np.abs(np.diff(start, prepend=start[0])) > arm)  # between steps
    nearest = np.array([start[run == k].min() for k in range(run[-1] + 1)])
    return level & (nearest <= nearest.min() + arm)[run]


def smoothed(height: np.ndarray, inside: np.ndarray, size: int = 9) -> np.ndarray:
    """Height without specks (median over size x size cells)."""
    return median_filter(nearest_known(height, inside), size, mode="nearest")


def _extended_inverse(depth: np.ndarray) -> np.ndarray:
    """Inverse depth continued beyond the object, so that bilinear reading at its edge does not mix in background."""
    return nearest_known(np.where(depth > 0, 1 / np.maximum(depth, 1e-6), 0.0), depth > 0)
