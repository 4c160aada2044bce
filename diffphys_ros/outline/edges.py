"""The edge of a plain object to a fraction of a pixel: where the grey level passes half way between inside and outside."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates

from ..mask_border import border, runs

SMOOTH_PX = 3.0  # standard deviation along the outline over which staircases of the mask and bumps of the edge are evened out [chosen]
PLATEAU_PX = (4.0, 7.0)  # from the edge, on either side, where inside and outside are read: blur with an sd of 2 px has ended [chosen]
TURN_PX = 6.0  # the same for its direction, which wiggles more [chosen]
STEP_PX = 0.5  # between samples of a profile [numerical]
REFINE_PX = 6.0  # from the mask's border that its edge is looked for [chosen]
BORDER_PX = 3.0  # from the picture's border that no point may lie within [chosen]
SEAM_COSINE = 0.9  # between the colours, inside over outside, of the two neighbours of a point: with less a border between colours meets the edge there [chosen]
CORNER_ARM_PX, CORNER_COSINE = 8.0, np.cos(np.radians(35.0))  # arm over which an outline turns, and the turn that makes a corner [chosen]


@dataclass(frozen=True)
class Outline:
    """Points on an object's outline in one frame, evenly spaced along it."""

    pixels: np.ndarray  # [px], (P, 2)
    normals: np.ndarray  # unit vectors out of the object, (P, 2)
    level: np.ndarray  # grey level half way between inside and outside, (P,)
    contrast: np.ndarray  # grey levels inside over those outside, (P,)
    to_corner_px: np.ndarray  # distance along the outline to the next corner, (P,)
    tint: np.ndarray | None = None  # weights of red, green and blue that level and contrast are in, (P, 3); None: grey levels

    def only(self, kept: np.ndarray) -> Outline:
        """Some of its points, bool (P,)."""
        return replace(self, **{name: values[kept] for name, values in vars(self).items() if values is not None})

    def distances(self, frame: np.ndarray, reach_px: float) -> np.ndarray:
        """As `distances`, of an RGB frame (H, W, 3) uint8."""
        return distances(grey_of(frame) if self.tint is None else frame, self.pixels, self.normals, self.level, reach_px, self.contrast, self.tint)


def grey_of(frame: np.ndarray) -> np.ndarray:
    """Luma of an RGB frame (H, W, 3) uint8, not rounded, float32 (H, W)."""
    return frame @ np.array([0.299, 0.587, 0.114], np.float32)


def outline_of(grey: np.ndarray, mask: np.ndarray, spacing_px: float) -> Outline:
    """The outline of a mask (H, W) in a picture (H, W), float32; nothing of it lies at the picture's border. Empty where all does."""
    return _joined([_refined(grey, run, round(spacing_px)) for run in _inner_runs(mask)])


def coloured_outline(frame: np.ndarray, mask: np.ndarray, spacing_px: float) -> Outline:
    """As `outline_of`, of an RGB frame (H, W, 3) uint8, read point by point in the colour that tells inside from outside best."""
    found = []
    for run in _inner_runs(mask):
        chosen, nought = _every(run, round(spacing_px)), np.zeros(len(run))
        found.append(tuple(each[chosen] for each in (run, _outward(run), nought, nought, _to_corner(run))))
    outline = _joined(found)
    sides = _sides_by_channel(frame, outline)
    outline = _leveled(replace(outline, tint=_tint(sides)), sides)
    moved = np.nan_to_num(outline.distances(frame, REFINE_PX))
    outline = replace(outline, pixels=outline.pixels + moved[:, None] * outline.normals)
    sides = _sides_by_channel(frame, outline)
    outline = _leveled(outline, sides)
    return replace(outline, contrast=np.where(_at_seam(sides), 0.0, outline.contrast))


def _joined(found: list[tuple[np.ndarray, ...]]) -> Outline:
    return Outline(*(np.concatenate(each) for each in zip(*found, strict=True))) if found else Outline(*np.zeros((2, 0, 2)), *np.zeros((3, 0)))


def _every(run: np.ndarray, step: int) -> np.ndarray:
    """Numbers of every `step`-th point of a run (n, 2)."""
    return np.arange(step // 2, len(run), max(step, 1))


def _inner_runs(mask: np.ndarray) -> list[np.ndarray]:
    """The pieces of a mask's border inside the picture, smooth, with points a pixel apart."""
    path = border(mask).astype(float)
    height, width = mask.shape
    inside = np.asarray(((path > BORDER_PX) & (path < np.array([width, height]) - 1 - BORDER_PX)).all(1))
    pieces = [np.concatenate([path, path[: int(4 * SMOOTH_PX)]])] if inside.all() else [path[run] for run in runs(inside)]  # the whole, closed
    return [run for run in map(_evenly, pieces) if len(run) > 4 * SMOOTH_PX]


def _evenly(run: np.ndarray) -> np.ndarray:
    """A path (n, 2), smoothed, with points a pixel apart."""
    smooth = gaussian_filter1d(run, SMOOTH_PX, axis=0, mode="nearest")
    arc = np.r_[0, np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))]
    at = np.arange(0, arc[-1], 1.0)
    return np.stack([np.interp(at, arc, smooth[:, i]) for i in (0, 1)], 1)


def _refined(grey: np.ndarray, run: np.ndarray, step: int) -> tuple[np.ndarray, ...]:
    """The fields of Outline for every `step`-th point of an even run (n, 2)."""
    normal = _outward(run)
    level, contrast = _half_level(grey, run, normal)
    moved = distances(grey, run, normal, level, REFINE_PX, contrast)
    known = np.isfinite(moved)
    if known.sum() < 2:
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0)
    moved = np.interp(np.arange(len(run)), np.flatnonzero(known), moved[known])
    run = run + gaussian_filter1d(moved, SMOOTH_PX, mode="nearest")[:, None] * normal
    normal = _outward(run)
    level, contrast = _half_level(grey, run, normal)
    chosen = _every(run, step)
    return run[chosen], normal[chosen], level[chosen], contrast[chosen], _to_corner(run)[chosen]


def _outward(run: np.ndarray) -> np.ndarray:
    """Unit normals (n, 2) of an even run of a mask's border."""
    along = np.gradient(gaussian_filter1d(run, TURN_PX, axis=0, mode="nearest"), axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.stack([-along[:, 1], along[:, 0]], 1)


def _half_level(grey: np.ndarray, pixels: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    inner, outer = _sides(grey, pixels, normals)
    inner, outer = (gaussian_filter1d(each, 2 * SMOOTH_PX, mode="nearest") if len(each) > 1 else each for each in (inner, outer))
    return (inner + outer) / 2, inner - outer


def _sides(grey: np.ndarray, pixels: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grey levels (P,) inside and outside of points (P, 2); NaN outside the picture."""
    reach = np.arange(PLATEAU_PX[0], PLATEAU_PX[1] + 0.1)
    inner, outer = (np.median(profiles(grey, pixels, normals, side * reach), axis=1) for side in (-1, 1))
    return inner, outer


def _to_corner(run: np.ndarray) -> np.ndarray:
    """Distance [px] of points a pixel apart (n, 2) to the next place at which the run turns sharply."""
    arm = int(CORNER_ARM_PX)
    if len(run) <= 2 * arm:
        return np.zeros(len(run))
    before, after = run[arm:-arm] - run[: -2 * arm], run[2 * arm :] - run[arm:-arm]
    cosine = (before * after).sum(1) / np.maximum(np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1), 1e-12)
    sharp = arm + np.flatnonzero(cosine < CORNER_COSINE)
    return np.abs(np.arange(len(run))[:, None] - sharp).min(1).astype(float) if len(sharp) else np.full(len(run), float(len(run)))


def _sides_by_channel(frame: np.ndarray, outline: Outline) -> np.ndarray:
    """Levels (2, P, 3) of red, green and blue inside and outside of an outline's points in an RGB frame; NaN outside the picture."""
    return np.stack([_sides(frame[..., c].astype(np.float32), outline.pixels, outline.normals) for c in range(3)], -1)


def _tint(sides: np.ndarray) -> np.ndarray:
    """Weights (P, 3) of the channels under which the two sides (2, P, 3) of an outline differ most, much the same for neighbours."""
    difference = sides[0] - sides[1]
    known = np.isfinite(difference).all(1)
    if len(known) > 1:
        difference = gaussian_filter1d(np.where(known[:, None], difference, 0.0), SMOOTH_PX, axis=0, mode="nearest")
    return difference / np.maximum(np.linalg.norm(difference, axis=1, keepdims=True), 1e-9)


def _at_seam(sides: np.ndarray) -> np.ndarray:
    """Where an outline's colours (2, P, 3), inside over outside, are other ones on one side of a point than on the other, bool (P,): what slides along
    itself brings another edge there."""
    colour = sides[0] - sides[1]
    colour = colour / np.maximum(np.linalg.norm(colour, axis=1, keepdims=True), 1e-9)
    cosine = np.pad((colour[2:] * colour[:-2]).sum(1), 1, constant_values=1.0) if len(colour) > 2 else np.ones(len(colour))
    return ~(cosine >= SEAM_COSINE)


def _leveled(outline: Outline, sides: np.ndarray) -> Outline:
    """With level and contrast of its two sides (2, P, 3) under its tint."""
    inner, outer = (sides * outline.tint).sum(-1)
    return replace(outline, level=(inner + outer) / 2, contrast=inner - outer)


def profiles(picture: np.ndarray, pixels: np.ndarray, normals: np.ndarray, reach: np.ndarray, tint: np.ndarray | None = None) -> np.ndarray:
    """Levels (P, S) of a grey picture (H, W), or of one of three channels (H, W, 3) under a tint (P, 3), along normals (P, 2) of pixels (P, 2), at
    distances (S,) [px]; NaN outside the picture."""
    if tint is not None:
        return np.sum([weight[:, None] * profiles(picture[..., c].astype(np.float32), pixels, normals, reach) for c, weight in enumerate(tint.T)], axis=0)
    at = pixels[:, None] + reach[:, None] * normals[:, None]
    return map_coordinates(picture, [at[..., 1], at[..., 0]], order=1, mode="constant", cval=np.nan)


def distances(
    picture: np.ndarray,
    pixels: np.ndarray,
    normals: np.ndarray,
    level: np.ndarray,
    reach_px: float,
    contrast: np.ndarray | None = None,
    tint: np.ndarray | None = None,
) -> np.ndarray:
    """Signed distance (P,) [px] along its normal at which the picture leaves each point's inside: the crossing of its level nearest to the point;
    NaN where there is none within reach."""
    reach = np.arange(-reach_px, reach_px + STEP_PX / 2, STEP_PX)
    above = profiles(picture, pixels, normals, reach, tint) - level[:, None]
    if contrast is not None:
        above = above * np.sign(contrast)[:, None]
    elif np.nanmean(above[:, 0]) < np.nanmean(above[:, -1]):
        above = -above  # a dark object
    leaves = (above[:, :-1] > 0) & (above[:, 1:] <= 0)
    place = np.where(leaves, np.abs(reach[:-1] + STEP_PX / 2), np.inf)
    rows, k = np.arange(len(pixels)), place.argmin(1)
    a, b = above[rows, k], above[rows, k + 1]
    share = np.divide(a, a - b, out=np.zeros(len(a)), where=a != b)
    return np.where(np.isfinite(place[rows, k]), reach[k] + STEP_PX * share, np.nan)


def edge_levels(frame: np.ndarray, pixels: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grey levels half way between inside and outside, and the inside's over the outside's, (P,) each, of an RGB frame at points (P, 2) of an outline."""
    inner, outer = _sides(grey_of(frame), pixels, normals)
    inner, outer = (np.where(np.isfinite(each), each, np.nanmedian(each)) for each in (inner, outer))
    return (inner + outer) / 2, inner - outer


def edge_distances(frame: np.ndarray, pixels: np.ndarray, normals: np.ndarray, level: np.ndarray, contrast: np.ndarray, reach_px: float) -> np.ndarray:
    """As `distances`, of an RGB frame."""
    return distances(grey_of(frame), pixels, normals, level, reach_px, contrast)
