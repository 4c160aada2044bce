"""Sub-pixel outlines of a raster region: closed polylines with corners kept and staircases smoothed. numpy and scipy only."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_closing, gaussian_filter1d

CORNER_COSINE = np.cos(np.radians(40.0))  # sharper turns over an arm are corners, gentler ones curves [chosen]
ARM_SHARE = 0.4  # arm of the corner test as a share of the spacing [chosen]
SMOOTH_SHARE = 0.2  # standard deviation of the smoothing as a share of the spacing [chosen]


def boundary_loops(inside: np.ndarray) -> list[np.ndarray]:
    """Closed boundaries of a region, the region on the left: midpoints (n, 2) of the cell sides, in cells (centres at integers)."""
    padded = np.pad(inside, 1)
    steps = (((1, 0), (1, -1), (1, 1)), ((0, 1), (1, 1), (-1, 1)), ((-1, 0), (-1, 1), (-1, -1)), ((0, -1), (-1, -1), (1, -1)))
    follow: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (di, dj), start, end in steps:
        open_side = padded & ~np.roll(padded, (-di, -dj), (0, 1))
        cells = 2 * (np.argwhere(open_side) - 1)
        for a, b in zip((cells + start).tolist(), (cells + end).tolist(), strict=True):
            follow.setdefault(tuple(a), []).append(tuple(b))
    loops = []
    while follow:
        loops.append(_chain(follow))
    return loops


def _chain(follow: dict[tuple[int, int], list[tuple[int, int]]]) -> np.ndarray:
    """Takes one closed loop of corners (in half cells) out of the successor table and returns its side midpoints (in cells)."""
    at = first = next(iter(follow))
    corners = [at]
    while True:
        ends = follow[at]
        at = ends.pop()
        if not ends:
            del follow[corners[-1]]
        if at == first:
            break
        corners.append(at)
    points = np.array(corners, float) / 2
    return 0.5 * (points + np.roll(points, -1, 0))


def smooth_loop(loop: np.ndarray, spacing: float, held: np.ndarray | None = None) -> list[np.ndarray]:
    """Pieces of a closed boundary between its corners, smoothed over a share of `spacing` (in cells) and sampled about
    `spacing` apart; each piece (n, 2) ends where the next one begins. Where the sides that are `held` (k,) begin and end there are corners."""
    arm = max(round(ARM_SHARE * spacing), 2)
    corners = _corners(loop, arm)
    if held is not None:
        ends = _ends(held, arm)
        off = np.abs(corners[:, None] - ends)
        corners = np.union1d(corners[(np.minimum(off, len(loop) - off) > arm).all(1)], ends)
    if not len(corners):
        closed = np.vstack([gaussian_filter1d(loop, SMOOTH_SHARE * spacing, axis=0, mode="wrap")] * 2)[: len(loop) + 1]
        return [_resample(closed, spacing, at_least=8)]
    pieces = []
    for a, b in zip(corners, np.roll(corners, -1), strict=True):
        index = np.arange(a, b + 1 if b > a else b + len(loop) + 1) % len(loop)
        pieces.append(_resample(_smooth_open(loop[index], SMOOTH_SHARE * spacing), spacing))
    return pieces


def _corners(loop: np.ndarray, arm: int) -> np.ndarray:
    """Indices of the sharpest points of every sharp turn."""
    ahead, behind = np.roll(loop, -arm, 0) - loop, loop - np.roll(loop, arm, 0)
    cosine = (ahead * behind).sum(1) / np.maximum(np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1), 1e-12)
    around = np.stack([np.roll(cosine, k) for k in range(-arm, arm + 1)])
    sharp = np.flatnonzero((cosine < CORNER_COSINE) & (cosine <= around.min(0) + 1e-12))
    if len(sharp) < 2:
        return sharp
    return sharp[np.diff(sharp, append=sharp[0] + len(loop)) > arm // 2]  # of equal neighbours keep the last


def _ends(held: np.ndarray, gap: int) -> np.ndarray:
    """Indices of the first and the last of every run of `held` sides (k,) of a closed boundary; gaps of up to `gap` belong to a run."""
    bridged = binary_closing(np.tile(held, 3), np.ones(gap + 1, bool))[len(held) : 2 * len(held)]
    return np.flatnonzero(bridged & ~(np.roll(bridged, 1) & np.roll(bridged, -1)))


def _smooth_open(points: np.ndarray, sigma: float) -> np.ndarray:
    """Gaussian average along an open polyline that keeps its ends (odd reflection)."""
    n = len(points)
    reach = min(n - 1, int(4 * sigma) + 1)
    if reach < 1:
        return points
    before, after = 2 * points[0] - points[reach:0:-1], 2 * points[-1] - points[-2 : -2 - reach : -1]
    return gaussian_filter1d(np.vstack([before, points, after]), sigma, axis=0)[reach : reach + n]


def _resample(points: np.ndarray, spacing: float, at_least: int = 1) -> np.ndarray:
    """Points at equal arc length, ends kept."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = max(round(arc[-1] / spacing), at_least)
    at = np.linspace(0, arc[-1], count + 1)
    return np.stack([np.interp(at, arc, points[:, i]) for i in (0, 1)], 1)


def interface_lines(part: np.ndarray, inside: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Open polylines between different parts inside the region, sampled about `spacing` apart, in cells.

    Outlines of every part but the first, cut where they run along the outer boundary.
    """
    lines = []
    for number in np.unique(part[inside])[1:]:
        region = inside & (part == number)
        for loop in boundary_loops(region):
            lines += _inner_runs(loop, inside & (part < number), spacing)
    return lines


def _inner_runs(loop: np.ndarray, other: np.ndarray, spacing: float) -> list[np.ndarray]:
    """The runs of a loop along which an `other` cell is the neighbour."""
    padded = np.pad(other, 1)
    half = np.floor(loop), np.ceil(loop)
    shared = np.any([padded[tuple((h + 1).astype(int).T)] for h in half], axis=0)
    if not shared.any():
        return []
    first = int(np.flatnonzero(~shared)[0]) if not shared.all() else 0
    order = np.roll(np.arange(len(loop)), -first)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], shared[order].astype(int), [0]])))
    runs = [loop[order[a:b]] for a, b in edges.reshape(-1, 2) if b - a > 0.5 * spacing]
    return [_resample(_smooth_open(run, SMOOTH_SHARE * spacing), spacing) for run in runs]
