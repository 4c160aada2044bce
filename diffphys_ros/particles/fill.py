"""Particles that fill a body."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import reduce

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..types import Body, Particles

GHOST_CELLS = 0.5  # grid cells behind the clamp that ghosts fill: further back the quadratic B-spline reaches held nodes alone
LEAST_COVER = 0.3  # of a lattice cell: less than that is handed to a neighbour

Overlap = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Columns:
    """Lattice columns along the thickness axis."""

    cell: np.ndarray  # lattice cell along x and y, shape (C, 2)
    centre: np.ndarray  # centroid of the covered area, body x and y [m], shape (C, 2)
    second: np.ndarray  # second moment of the covered area about y = 0 [m^4], shape (C,)
    part: np.ndarray  # 1..n, shape (C,)
    area: np.ndarray  # covered area [m^2], shape (C,)
    volume: np.ndarray  # [m^3], shape (C,)

    def keep(self, index: np.ndarray) -> Columns:
        return Columns(*(getattr(self, f.name)[index] for f in fields(self)))

    def joined(self, other: Columns) -> Columns:
        """These columns and then the others."""
        return Columns(*(np.concatenate([getattr(self, f.name), getattr(other, f.name)]) for f in fields(self)))


def fill(body: Body, dx: float, per_cell: float) -> Particles:
    """Particles on a lattice of spacing dx / per_cell that has a lattice plane on x = 0 and is symmetric about z = 0.

    A column's particles share the volume that the silhouette cuts out of it, so that all particles that are no ghosts sum to
    `body.volume_m3`, and sit at its centroid, spread so that second moments are the solid's: n equal layers at their middles
    would bend like a bar that is 1 - 1/n^2 times as stiff. Behind a clamp, ghosts continue the root by half a grid cell.
    Sorted in grid order.
    """
    if not (dx > 0 and per_cell > 0):
        raise InputError(f"particles: dx is {dx:g} m and per_cell is {per_cell:g}, both must be positive; correct experiment.cells or experiment.per_cell")
    spacing = dx / per_cell
    own = _spread(_columns(body, spacing))
    columns = own.joined(_behind_clamp(own, spacing, dx)) if body.clamped else own
    thickness = columns.volume / columns.area
    count = np.maximum(np.rint(thickness / spacing).astype(int), 1)
    column = np.repeat(np.arange(len(count)), count)
    x = np.concatenate([columns.centre[column], (_layers(count) * thickness[column])[:, None]], 1)
    order = grid_order(x, dx)
    x, column = x[order], column[order]
    part = columns.part[column]
    return Particles(x, (columns.volume / count)[column], part, body.density[part - 1], body.poisson[part - 1], column >= len(own.area))


def _layers(count: np.ndarray) -> np.ndarray:
    """Heights of `count` (C,) equal layers in a column of unit thickness, one column after the other, about its middle.

    Their mean square is the column's, 1/12, where there are two or more.
    """
    layer = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    middle = (layer + 0.5) / np.repeat(count, count) - 0.5
    return middle / np.repeat(np.sqrt(1 - 1 / np.maximum(count, 2) ** 2), count)


def _spread(columns: Columns) -> Columns:
    """Columns moved apart along y, about the middle of each unbroken run, until the run's second moment is the solid's."""
    order = np.lexsort((columns.cell[:, 1], columns.cell[:, 0]))
    step = np.diff(columns.cell[order], axis=0)
    run = np.empty(len(order), int)
    run[order] = np.cumsum(np.r_[0, (step[:, 0] != 0) | (step[:, 1] > 1)])
    y, thickness = columns.centre[:, 1], columns.volume / columns.area
    total, first = (np.bincount(run, columns.volume * m) for m in (1.0, y))
    middle = (first / total)[run]
    solid = np.bincount(run, thickness * columns.second) - first**2 / total
    points = np.bincount(run, columns.volume * (y - middle) ** 2)
    wider = np.sqrt(np.divide(solid, points, where=points > 0, out=np.ones_like(points)))
    return replace(columns, centre=np.stack([columns.centre[:, 0], middle + wider[run] * (y - middle)], -1))


def _columns(body: Body, spacing: float) -> Columns:
    """Columns of every part by itself, so that parts end where the raster says and not at the next lattice plane."""
    low = 0.0 if body.clamped else _low_edge(body, 0)
    overlaps = _overlaps(body, 0, low, spacing), _overlaps(body, 1, _centred_edge(body, spacing), spacing)
    found = [_columns_of(body, i + 1, overlaps, spacing) for i in range(body.parts)]
    return reduce(Columns.joined, [_merged(columns, spacing) for columns in found if len(columns.area)])


def _columns_of(body: Body, part: int, overlaps: tuple[Overlap, Overlap], spacing: float) -> Columns:
    """Columns that one part touches."""
    (wx, mx, _), (wy, my, sy) = overlaps
    flat = (body.inside & (body.part == part)).astype(float)
    area = wx @ flat @ wy.T
    volume = wx @ (flat * 2 * body.half_thickness) @ wy.T
    touched = area > 1e-9 * spacing**2
    centre = np.stack([mx @ flat @ wy.T, wx @ flat @ my.T], -1)[touched] / area[touched][:, None]
    number = np.full(touched.sum(), part)
    return Columns(np.argwhere(touched), centre, (wx @ flat @ sy.T)[touched], number, area[touched], volume[touched])


def _merged(columns: Columns, spacing: float) -> Columns:
    """Columns that cover at least a share of their cell; smaller pieces go to the nearest of them."""
    large = columns.area >= LEAST_COVER * spacing**2
    if not large.any():
        return columns
    _, owner = cKDTree(columns.centre[large]).query(columns.centre)
    second, area, volume = (np.bincount(owner, m, large.sum()) for m in (columns.second, columns.area, columns.volume))
    centre = np.stack([np.bincount(owner, columns.area * columns.centre[:, i], large.sum()) for i in (0, 1)], -1) / area[:, None]
    return replace(columns.keep(np.flatnonzero(large)), centre=centre, second=second, area=area, volume=volume)


def _overlaps(body: Body, axis: int, low: float, spacing: float) -> Overlap:
    """Length of every raster cell inside every lattice cell along an axis, its first and its second moment, each (lattice, raster)."""
    edges = body.origin[axis] + body.pitch_m * (np.arange(body.inside.shape[axis] + 1) - 0.5)
    first = int(np.floor((edges[0] - low) / spacing + 1e-9))
    last = int(np.ceil((edges[-1] - low) / spacing - 1e-9))
    bounds = low + spacing * np.arange(first, last + 1)
    a = np.maximum(bounds[:-1, None], edges[None, :-1])
    b = np.maximum(np.minimum(bounds[1:, None], edges[None, 1:]), a)
    return b - a, (b**2 - a**2) / 2, (b**3 - a**3) / 3


def _low_edge(body: Body, axis: int) -> float:
    used = np.flatnonzero(body.inside.any(1 - axis))
    return float(body.origin[axis] + body.pitch_m * (used[0] - 0.5))


def _centred_edge(body: Body, spacing: float) -> float:
    """A lattice edge in y such that whole cells sit symmetrically in the silhouette's width."""
    used = np.flatnonzero(body.inside.any(0))
    width = body.pitch_m * (used[-1] - used[0] + 1)
    middle = body.origin[1] + body.pitch_m * (used[0] + used[-1]) / 2
    return float(middle - spacing * max(round(width / spacing), 1) / 2)


def _behind_clamp(own: Columns, spacing: float, dx: float) -> Columns:
    """The first layer of columns repeated behind the plane x = 0."""
    first = own.keep(np.flatnonzero(own.centre[:, 0] < spacing))
    layers = int(np.ceil(GHOST_CELLS * dx / spacing - 1e-9))
    behind = first.keep(np.tile(np.arange(len(first.area)), layers))
    x = spacing * (0.5 - np.repeat(np.arange(1, layers + 1), len(first.area)))
    return replace(behind, centre=np.stack([x, behind.centre[:, 1]], -1))


def grid_order(x: np.ndarray, dx: float) -> np.ndarray:
    cell = np.floor(x / dx + 1e-9).astype(int)
    return np.lexsort((x[:, 2], x[:, 1], x[:, 0], cell[:, 2], cell[:, 1], cell[:, 0]))
