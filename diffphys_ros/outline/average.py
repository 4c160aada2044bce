"""An object's outline at rest, averaged over the frames that show it there: one compressed frame has it wrong by half a pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from ..types import Clip, object_mask
from .edges import Outline, distances, edge_levels, grey_of, outline_of

NEAR, CLOSE = 24, 0.35  # frames nearest to rest, over which is averaged; of the widest swing that they may be aside [chosen]
REACH_PX = 15.0  # that an edge may lie off its place in frame 0 in them [chosen]
STEP_PX = 2  # between points [numerical]
CORNER_PX = 12.0  # from a corner within which a smoothed outline cuts it off [chosen]
OFF_MASK_PX = 2  # that an edge may lie off the mask's border there [chosen]
FINER = 8  # rows a pixel in which the covered share is measured [numerical]
END_SHARE = 0.1  # of the object's length: the end face lies in it [chosen]


def rest_outline(clip: Clip) -> Outline:
    """The outline of a clip whose frame 0 is nearest to rest, as it is in that pose, in order along it. Needs `clip.labels`."""
    assert clip.labels is not None
    inside = object_mask(clip.labels)
    outline = outline_of(grey_of(clip.frames[0]), inside[0], STEP_PX)
    swing = _swing(inside)
    aside = np.where(clip.seen, np.abs(swing), np.inf)
    near = np.argsort(aside, kind="stable")[: max(min(NEAR, int((aside <= CLOSE * np.abs(swing).max()).sum())), 1)]
    outline = _leveled(outline, clip.frames[near])
    seen = _seen(outline, clip.frames[near])
    return replace(outline, pixels=outline.pixels + _at_rest(seen, swing[near], outline)[:, None] * outline.normals)


def _seen(outline: Outline, frames: np.ndarray) -> np.ndarray:
    """Distances (K, P) [px] of an outline's edges in RGB frames (K, H, W, 3)."""
    return np.stack([distances(grey_of(frame), outline.pixels, outline.normals, outline.level, REACH_PX, outline.contrast) for frame in frames])


def _leveled(outline: Outline, frames: np.ndarray) -> Outline:
    """With the levels half way between inside and outside that RGB frames (K, H, W, 3) have, not frame 0 alone: a compressed one has them wrong by a grey
    level or two, and with them its edges all to one side."""
    places = outline.pixels + np.nan_to_num(_seen(outline, frames))[..., None] * outline.normals
    level, contrast = np.median([edge_levels(frame, place, outline.normals) for frame, place in zip(frames, places, strict=True)], axis=0)
    unknown = (outline.contrast == 0) | ~np.isfinite(level) | ~np.isfinite(contrast)
    return replace(outline, level=np.where(unknown, outline.level, level), contrast=np.where(unknown, outline.contrast, contrast))


def _at_rest(seen: np.ndarray, swing: np.ndarray, outline: Outline) -> np.ndarray:
    """What distances (K, P) are where the swing (K,) is nought, (P,): straight lines through them, by medians; 0 where hardly anything is seen."""
    known = np.isfinite(seen)
    weight = known.sum(0)
    moved, swung = np.where(known, seen, 0.0), np.where(known, swing[:, None], 0.0)
    middle, centre = moved.sum(0) / np.maximum(weight, 1), swung.sum(0) / np.maximum(weight, 1)
    spread = np.where(known, swing[:, None] - centre, 0.0)
    slope = (spread * moved).sum(0) / np.maximum((spread**2).sum(0), 1e-9)
    level = np.ma.median(np.ma.masked_array(seen - slope * swing[:, None], ~known), axis=0).filled(0.0)
    return np.where(weight >= len(seen) / 2, level, np.where(weight > 0, np.clip(middle, -1, 1), 0.0))


def _swing(inside: np.ndarray) -> np.ndarray:
    """How far the object's centroid is from where it is in frame 0, along the direction in which it moves most (T,) [px]."""
    size = np.maximum(inside.sum((1, 2)), 1)
    centre = np.stack([(inside.sum(axis) @ np.arange(inside.shape[3 - axis])) / size for axis in (1, 2)], 1)
    moved = centre - centre.mean(0)
    along = moved @ np.linalg.svd(moved, full_matrices=False)[2][0]
    return along - along[0]


def rest_cover(clip: Clip, outline: Outline) -> np.ndarray:
    """Share of each pixel that the object covers at rest, float32 (H, W): inside its outline there, by the grey levels of frame 0 about corners. Cut
    off, the corners of a free end would make it lighter. Needs `clip.labels`."""
    assert clip.labels is not None
    mask, grey = object_mask(clip.labels[0]), grey_of(clip.frames[0])
    inner, outer = binary_erosion(mask, iterations=OFF_MASK_PX), binary_dilation(mask, iterations=OFF_MASK_PX)
    rows, columns = np.indices(mask.shape)
    cover = covered(outline.pixels, mask.shape)
    for k in np.flatnonzero((outline.to_corner_px < STEP_PX) & (outline.contrast != 0)):
        share = np.clip((grey - outline.level[k]) / outline.contrast[k] + 0.5, 0, 1)
        near = (columns - outline.pixels[k, 0]) ** 2 + (rows - outline.pixels[k, 1]) ** 2 < CORNER_PX**2
        cover[near] = np.where(inner, 1.0, np.where(outer, share, 0.0))[near]
    return cover


def covered(outline: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Share of each pixel inside a closed outline (P, 2) [px] that does not cross itself, float32 (H, W): exact along rows, FINER rows a pixel."""
    height, width = shape
    rows = (np.arange(height * FINER) + 0.5) / FINER - 0.5
    start, end = outline, np.roll(outline, -1, 0)
    row, edge = np.nonzero((start[:, 1] <= rows[:, None]) != (end[:, 1] <= rows[:, None]))
    a, b = start[edge], end[edge]
    x = np.clip(a[:, 0] + (rows[row] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1]), -0.5, width - 0.5 - 1e-9)
    side = np.where(b[:, 1] > a[:, 1], 1.0, -1.0)
    column = np.floor(x + 0.5).astype(int)
    right = column + 0.5 - x  # share of its pixel that lies to the right of the crossing
    steps = np.zeros((height * FINER, width + 1))
    np.add.at(steps, (row, column), side * right)
    np.add.at(steps, (row, column + 1), side * (1 - right))
    return np.abs(np.cumsum(steps, 1)[:, :width]).reshape(height, FINER, width).mean(1).astype(np.float32)


def end_of(outline: np.ndarray, line_px: np.ndarray) -> float:
    """How far the far end of an outline (P, 2) lies from a line (2, 2) [px]: the middle of its end face."""
    along = (line_px[1] - line_px[0]) / np.linalg.norm(line_px[1] - line_px[0])
    across = np.array([-along[1], along[0]])
    far, beside = (outline - line_px[0]) @ across, (outline - line_px[0]) @ along
    far = far if far.mean() >= 0 else -far
    last = far > far.max() - END_SHARE * np.ptp(far)
    left, right = beside[last].min(), beside[last].max()
    face = last & (beside > left + (right - left) / 4) & (beside < right - (right - left) / 4)
    return float(np.median(far[face])) if face.any() else float(far.max())
