"""Parts of the object by colour: a connected piece each, or a few large ones, as many as the colours tell apart."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Settings
from ..inpaint import nearest_known
from ..ways import way_lengths

WINDOW_SHARE = 0.08  # side of the median window that removes texture, as a share of the root of the object's area
LEAST_DISTANCE = 18.0  # between the colours of two parts, in units of Lab chroma at medium lightness
LEAST_SEPARATION = 2.5  # the same distance against the spread inside the two parts
LEAST_SHARE = 0.015  # of the object that a part must cover
MOST_ENCLOSED, LEAST_ENCLOSED_SHARE = 0.6, 0.08  # of a part's outline inside the object, beyond which it is a spot or a seam unless it covers so much
LEAST_CONNECTED = 0.75  # of a colour's pixels that must be in its largest piece and those that cover LEAST_ENCLOSED_SHARE of the object
MEDIUM_LIGHTNESS = 60.0
EQUALLY_FAR = 0.1  # of the way to the clamp, by which perspective and the drawn edges let prongs of equal reach differ
REFINEMENTS = 4


def most_parts(settings: Settings) -> int:
    """`segment.max_parts`, and no more than there are values told part by part: whoever tells two densities sees two parts."""
    return min([settings.segment.max_parts, *settings.told_by_part])


def split_parts(frame: np.ndarray, mask: np.ndarray, *, max_parts: int) -> np.ndarray:
    """Part numbers 1..n in no special order, 0 off the mask, uint8 (H, W), from an RGB frame (H, W, 3).

    Colours are chroma over lightness (shading cancels) after a median that removes spots and lines. The largest number of
    clusters (k-means) is taken whose colours lie apart against their spread and of which each is essentially one connected piece, or a few
    large ones, such as the prongs of a fork; then edges are drawn again from the parts' full colour distributions, and every stray island
    joins its surroundings. What then is small and mostly enclosed is no part: a spot, or the mixed colours of a seam; nor is what then has the colour of
    another one: a side in the shade.
    """
    if not mask.any():
        return np.zeros(mask.shape, np.uint8)
    colour = texture_free_chroma(frame, mask)
    for count in range(min(max_parts, 8), 1, -1):
        parts = _clustered(colour, mask, count)
        if parts is not None:
            parts = whole_pieces(_redrawn(frame, mask, parts))
            if all(stands_for_itself(parts == k + 1, mask) for k in range(count)) and _apart(colour[mask], parts[mask] - 1):
                return parts
    return mask.astype(np.uint8)


def numbered(parts: np.ndarray, clamp_pixel: np.ndarray | None) -> np.ndarray:
    """Parts renumbered 1..n, uint8 (H, W): by the way inside the object from the clamp [px] to their nearest pixel, for a hook's tip hangs nearer
    to the clamp than its bend; those that are equally far and do not touch, as the prongs of a fork, from left to right. Without a clamp, largest first."""
    old = np.setdiff1d(np.unique(parts), 0)
    away = None if clamp_pixel is None or not len(old) else way_lengths(parts > 0, _nearest(parts > 0, clamp_pixel))
    ranks = {part: _rank(parts == part, clamp_pixel, away) for part in old}
    order = sorted(old, key=lambda part: ranks[part])
    if away is not None:
        order = [part for beside in _side_by_side(parts, order, ranks) for part in sorted(beside, key=lambda part: np.nonzero(parts == part)[1].mean())]
    table = np.zeros(256, np.uint8)
    table[order] = np.arange(1, len(order) + 1)
    return table[parts]


def texture_free_chroma(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Chroma at medium lightness of the surface under the texture, float32 (H, W, 2)."""
    lab = cv2.cvtColor(frame.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    chroma = lab[..., 1:] * (MEDIUM_LIGHTNESS / (lab[..., :1] + 10))
    inside = np.clip(nearest_known(chroma, mask) + 128, 0, 255).astype(np.uint8)
    side = max(5, 2 * int(WINDOW_SHARE * np.sqrt(mask.sum()) / 2) + 1)
    return np.stack([cv2.medianBlur(np.ascontiguousarray(inside[..., i]), side) for i in (0, 1)], -1).astype(np.float32) - 128


def whole_pieces(parts: np.ndarray) -> np.ndarray:
    """Parts reduced to their largest connected pieces and further ones as large as a part of its own; what was cut off joins the part that it
    touches nearest."""
    kept, least = np.zeros_like(parts), LEAST_ENCLOSED_SHARE * (parts > 0).sum()
    for part in np.setdiff1d(np.unique(parts), 0):
        regions, whole = _pieces(parts == part, least)
        kept[whole[regions]] = part
    return np.where(parts > 0, nearest_known(kept, kept > 0), 0).astype(np.uint8)


def _pieces(region: np.ndarray, least_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of connected pieces (H, W), 0 off them, and which of these are the largest or cover `least_px` at least."""
    count, regions, stats, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=4)
    area = np.r_[0, stats[1:, cv2.CC_STAT_AREA]]
    return regions, (area > 0) & ((area >= least_px) | (np.arange(count) == area.argmax()))


def _clustered(colour: np.ndarray, mask: np.ndarray, count: int) -> np.ndarray | None:
    """Label image of `count` colour clusters, or None where they are no parts."""
    values = colour[mask]
    if len(values) < count:
        return None
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 0.05)
    cv2.setRNGSeed(0)
    _, index, _ = cv2.kmeans(values, count, None, criteria, 8, cv2.KMEANS_PP_CENTERS)
    parts = np.zeros(mask.shape, np.uint8)
    parts[mask] = index[:, 0] + 1
    return parts if _apart(values, index[:, 0]) and all(_is_piece(parts == k + 1, mask) for k in range(count)) else None


def _apart(values: np.ndarray, index: np.ndarray) -> bool:
    """Whether the mean colours of clusters 0 .. n - 1, to which `values` (P, 2) belong by their `index` (P,), lie apart against their spread."""
    centres = [values[index == k].mean(0) for k in range(index.max() + 1)]
    spread = [float(np.median(np.linalg.norm(values[index == k] - centre, axis=1))) for k, centre in enumerate(centres)]
    for i in range(len(centres)):
        for j in range(i):
            distance = float(np.linalg.norm(centres[i] - centres[j]))
            if distance < max(LEAST_DISTANCE, LEAST_SEPARATION * (spread[i] + spread[j])):
                return False
    return True


def _is_piece(region: np.ndarray, mask: np.ndarray) -> bool:
    """Whether a colour's pixels are no scatter of spots."""
    area = mask.sum()
    regions, whole = _pieces(region, LEAST_ENCLOSED_SHARE * area)
    return bool(whole[regions].sum() > LEAST_CONNECTED * region.sum() and region.sum() > LEAST_SHARE * area)


def stands_for_itself(region: np.ndarray, mask: np.ndarray) -> bool:
    """Whether a part covers enough of the object, and more where most of its outline lies inside the object."""
    share = region.sum() / mask.sum()
    around = (cv2.dilate(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~region
    enclosed = (around & mask).sum() / max(around.sum(), 1)
    return bool(share > (LEAST_ENCLOSED_SHARE if enclosed > MOST_ENCLOSED else LEAST_SHARE))


def _redrawn(frame: np.ndarray, mask: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Every pixel given to the part whose colour histogram explains its small neighbourhood best."""
    lab = cv2.cvtColor(frame, cv2.COLOR_RGB2LAB)
    bins = (lab[..., 0] // 32).astype(int) * 1024 + (lab[..., 1] // 8).astype(int) * 32 + lab[..., 2] // 8
    count = int(parts.max())
    near = cv2.dilate((cv2.morphologyEx(parts, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0).astype(np.uint8), np.ones((13, 13), np.uint8)) > 0
    for _ in range(REFINEMENTS):
        score = np.stack([_evidence(bins, mask, parts == k + 1) for k in range(count)])
        parts = np.where(mask, np.where(near, 1 + np.argmax(score, 0), parts), 0).astype(np.uint8)
    return parts


def _evidence(bins: np.ndarray, mask: np.ndarray, region: np.ndarray) -> np.ndarray:
    histogram = np.bincount(bins[region], minlength=8 * 1024).astype(float).reshape(8, 32, 32)
    histogram = np.stack([cv2.GaussianBlur(layer, (0, 0), 1.0) for layer in histogram]).ravel() + 0.02
    likelihood = np.where(mask, np.log(histogram / histogram.sum())[bins], 0.0)
    return cv2.GaussianBlur(likelihood, (0, 0), 1.5) / np.maximum(cv2.GaussianBlur(mask.astype(float), (0, 0), 1.5), 1e-3)


def _nearest(mask: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    """The pixel of a mask (H, W) that is nearest to `pixel` (u, v), bool (H, W)."""
    v, u = np.nonzero(mask)
    k, found = np.hypot(u - pixel[0], v - pixel[1]).argmin(), np.zeros_like(mask)
    found[v[k], u[k]] = True
    return found


def _rank(region: np.ndarray, clamp_pixel: np.ndarray | None, away: np.ndarray | None) -> tuple[float, float]:
    """Where a part stands in the order; what no way leads to comes last, by its distance as the crow flies."""
    if clamp_pixel is None or away is None:
        return -float(region.sum()), 0.0
    v, u = np.nonzero(region)
    return float(away[region].min()), float(np.hypot(u - clamp_pixel[0], v - clamp_pixel[1]).min())


def _side_by_side(parts: np.ndarray, order: list[int], ranks: dict[int, tuple[float, float]]) -> list[list[int]]:
    """Parts in their order; in one list those that are as far from the clamp as the first of it and touch none of the others in it."""
    out: list[list[int]] = []
    for part in order:
        near = cv2.dilate((parts == part).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        touched = np.unique(parts[near])
        if out and ranks[part][0] / (1 + EQUALLY_FAR) < ranks[out[-1][0]][0] and not np.isin(out[-1], touched).any():
            out[-1].append(part)
        else:
            out.append([part])
    return out
