"""Particles that fill a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError
from ..types import Body, Particles

GHOST_CELLS = 2.0  # grid cells behind the clamp that ghosts fill: the reach of a quadratic B-spline and half a cell
LEAST_COVER = 0.3  # of a lattice cell: less than that is handed to a neighbour


@dataclass(frozen=True)
class Columns:
    """Lattice columns along the thickness axis."""

    centre: np.ndarray  # centroid of the covered area, body x and y [m], shape (C, 2)
    area: np.ndarray  # covered area [m^2], shape (C,)
    volume: np.ndarray  # [m^3], shape (C,)

    def keep(self, index: np.ndarray) -> Columns:
        return Columns(self.centre[index], self.area[index], self.volume[index])


def fill(body: Body, dx: float, per_cell: float) -> Particles:
    """Particles on a lattice of spacing dx / per_cell that has a lattice plane on x = 0 and is symmetric about z = 0.

    A column's particles share the volume that the silhouette cuts out of it, so that all particles that are no ghosts sum to
    `body.volume_m3`, and sit at its centroid. Behind a clamp, ghosts continue the root by two grid cells. Sorted in grid order.
    """
    if not (dx > 0 and per_cell > 0):
        raise InputError(f"particles: dx is {dx:g} m and per_cell is {per_cell:g}, both must be positive; correct particles.cells or particles.per_cell")
    spacing = dx / per_cell
    own = _columns(body, spacing)
    ghost = _behind_clamp(body, own, spacing, dx) if body.clamped else own.keep(np.arange(0))
    columns = Columns(*(np.concatenate([a, b]) for a, b in ((own.centre, ghost.centre), (own.area, ghost.area), (own.volume, ghost.volume))))
    count = np.maximum(np.rint(columns.volume / columns.area / spacing).astype(int), 1)
    column = np.repeat(np.arange(len(count)), count)
    layer = np.arange(len(column)) - np.repeat(np.cumsum(count) - count, count)
    thickness = (columns.volume / columns.area)[column]
    x = np.concatenate([columns.centre[column], (((layer + 0.5) / count[column] - 0.5) * thickness)[:, None]], 1)
    order = _grid_order(x, dx)
    x, column = x[order], column[order]
    part = body.part_at(x).astype(np.int64)
    return Particles(x, (columns.volume / count)[column], part, body.density[part - 1], body.poisson[part - 1], column >= len(own.area))


def _columns(body: Body, spacing: float) -> Columns:
    """Columns that the silhouette covers by at least a share of their cell; smaller pieces go to their nearest neighbour."""
    x_low = 0.0 if body.clamped else _low_edge(body, 0)
    wx, mx = _overlaps(body, 0, x_low, spacing)
    wy, my = _overlaps(body, 1, _centred_edge(body, spacing), spacing)
    flat = body.inside.astype(float)
    area = wx @ flat @ wy.T
    moment = np.stack([mx @ flat @ wy.T, wx @ flat @ my.T], -1)
    volume = wx @ (flat * 2 * body.half_thickness) @ wy.T
    touched = area > 1e-9 * spacing**2
    centre = moment[touched] / area[touched][:, None]
    return _merged(Columns(centre, area[touched], volume[touched]), spacing)


def _merged(columns: Columns, spacing: float) -> Columns:
    large = columns.area >= LEAST_COVER * spacing**2
    if not large.any():
        return columns
    _, owner = cKDTree(columns.centre[large]).query(columns.centre)
    area = np.bincount(owner, columns.area, large.sum())
    centre = np.stack([np.bincount(owner, columns.area * columns.centre[:, i], large.sum()) for i in (0, 1)], -1) / area[:, None]
    return Columns(centre, area, np.bincount(owner, columns.volume, large.sum()))


def _overlaps(body: Body, axis: int, low: float, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Length of every raster cell inside every lattice cell along an axis, and its first moment, both (lattice, raster)."""
    edges = body.origin[axis] + body.pitch_m * (np.arange(body.inside.shape[axis] + 1) - 0.5)
    first = int(np.floor((edges[0] - low) / spacing + 1e-9))
    last = int(np.ceil((edges[-1] - low) / spacing - 1e-9))
    bounds = low + spacing * np.arange(first, last + 1)
    a = np.maximum(bounds[:-1, None], edges[None, :-1])
    b = np.maximum(np.minimum(bounds[1:, None], edges[None, 1:]), a)
    return b - a, (b**2 - a**2) / 2


def _low_edge(body: Body, axis: int) -> float:
    used = np.flatnonzero(body.inside.any(1 - axis))
    return float(body.origin[axis] + body.pitch_m * (used[0] - 0.5))


def _centred_edge(body: Body, spacing: float) -> float:
    """A lattice edge in y such that whole cells sit symmetrically in the silhouette's width."""
    used = np.flatnonzero(body.inside.any(0))
    width = body.pitch_m * (used[-1] - used[0] + 1)
    middle = body.origin[1] + body.pitch_m * (used[0] + used[-1]) / 2
    return float(middle - spacing * max(round(width / spacing), 1) / 2)


def _behind_clamp(body: Body, own: Columns, spacing: float, dx: float) -> Columns:
    """The first layer of columns repeated behind the plane x = 0."""
    first = own.keep(np.flatnonzero(own.centre[:, 0] < spacing))
    layers = int(np.ceil(GHOST_CELLS * dx / spacing - 1e-9))
    shift = spacing * np.arange(1, layers + 1)
    centre = first.centre[None] - np.stack([shift, np.zeros(layers)], -1)[:, None]
    centre[..., 0] = -shift[:, None] + spacing / 2
    return Columns(centre.reshape(-1, 2), np.tile(first.area, layers), np.tile(first.volume, layers))


def _grid_order(x: np.ndarray, dx: float) -> np.ndarray:
    cell = np.floor(x / dx + 1e-9).astype(int)
    return np.lexsort((x[:, 2], x[:, 1], x[:, 0], cell[:, 2], cell[:, 1], cell[:, 0]))
