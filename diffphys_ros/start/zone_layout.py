"""A body cut into zones along its limbs, where nobody knows the borders of its materials. numpy and scipy only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..inpaint import nearest_known
from ..types import Body
from ..ways import STEPS, shifted_pairs, way_lengths

MOST_STEPS = 12  # from the clamp to the farthest end; a limb that branches has its own zones in each branch [numerical]
SLENDER = 0.5  # least length of a step over the limbs' width or thickness, whichever is less: shorter ones do not bend on their own [chosen]
HIDDEN_SD = 0.5 * np.log(10.0)  # standard deviation of the log ratio of E at a border that nothing drawn shows: such materials look alike [chosen]
LEAST_SHARE = 0.3  # of a step's mean area that a zone of its own must have [chosen]


@dataclass(frozen=True)
class Division:
    """Zones of a body's raster, numbered from the clamp outwards; each lies in one part and is connected."""

    zone: np.ndarray  # 1..K on the silhouette, extended to its nearest value outside, (nx, ny) uint8
    part: np.ndarray  # 1..n of every zone, (K,)
    away: np.ndarray  # way from the clamp over the longest, 0..1, rising, (K,)
    neighbours: np.ndarray  # pairs of zones that touch, counted from 0, (B, 2)

    @property
    def count(self) -> int:
        """Number of zones K."""
        return len(self.part)

    @classmethod
    def of(cls, body: Body) -> Division:
        """Slices of equal length of the way from the clamp, inside parts, branch by branch."""
        away = path_length(body.inside)
        length = max(float(away[body.inside].max()), 1.0)
        steps = _steps(body, length)
        step = np.minimum((away / length * steps).astype(int), steps - 1)
        labels = np.zeros(body.inside.shape, int)
        for part in np.unique(body.part[body.inside]):
            here = body.inside & (body.part == part)
            labels[here] = _merged(_pieces(step, here), here, LEAST_SHARE * body.inside.sum() / steps)[here] + labels.max()
        kept = np.unique(labels[body.inside])
        distance = ndimage.mean(away, labels, kept)
        number = np.zeros(labels.max() + 1, np.uint8)
        number[kept[np.argsort(distance, kind="stable")]] = np.arange(1, len(kept) + 1)
        zone = number[labels]
        part_of = np.array([body.part[zone == k + 1][0] for k in range(len(kept))])
        return cls(nearest_known(zone, body.inside), part_of, np.sort(distance) / length, _touching(np.where(body.inside, zone, 0)))

    def divide(self, body: Body) -> Body:
        """The body with the zones as its parts."""
        index = self.part.astype(int) - 1
        return replace(body, part=self.zone, density=body.density[index], poisson=body.poisson[index])


def _steps(body: Body, length: float) -> int:
    """Number of steps along a way of `length` raster cells."""
    width = body.inside.sum() / length
    thickness = 2 * float(body.half_thickness[body.inside].mean()) / body.pitch_m
    return int(np.clip(length / (SLENDER * min(width, thickness)), 2, MOST_STEPS))


def path_length(inside: np.ndarray) -> np.ndarray:
    """Length [cells] of the way inside a silhouette (nx, ny) from its first row to every cell; 0 outside. Pieces that no way
    leads to count from where they begin."""
    first = np.flatnonzero(inside.any(1))[0]
    rows = np.arange(len(inside))[:, None]
    found = way_lengths(inside, inside & (rows == first))
    return np.where(inside, np.where(np.isfinite(found), found, rows - first), 0.0)


def _pieces(step: np.ndarray, here: np.ndarray) -> np.ndarray:
    """Connected pieces 1.. of every step inside a region, 0 elsewhere."""
    labels = np.zeros(step.shape, int)
    for s in np.unique(step[here]):
        found, _ = ndimage.label(here & (step == s), np.ones((3, 3)))
        labels += np.where(found > 0, found + labels.max(), 0)
    return labels


def _merged(labels: np.ndarray, here: np.ndarray, least: float) -> np.ndarray:
    """Pieces with fewer than `least` cells joined to the nearest large one of the region; the largest always stands."""
    area = np.bincount(labels.ravel())
    area[0] = 0
    large = area >= min(least, area.max())
    return nearest_known(np.where(large[labels], labels, 0), here & large[labels])


def _touching(zone: np.ndarray) -> np.ndarray:
    """Pairs (B, 2) of zones, counted from 0, with a common border; 0 in `zone` is none."""
    pairs = np.concatenate([np.stack(shifted_pairs(zone.astype(int), i, j), 1) for i, j in STEPS[:2]])
    pairs = np.sort(pairs[(pairs > 0).all(1) & (pairs[:, 0] != pairs[:, 1])], 1) - 1
    return np.unique(pairs, axis=0)
