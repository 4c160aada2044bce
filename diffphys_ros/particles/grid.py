"""A grid fitted to the particles: as small as their motion allows, aligned with the clamp and the mid-plane."""

from __future__ import annotations

import numpy as np

from ..types import Body, Grid, Particles

CLAMP_INSET = 1 / 6  # cells by which the last held plane of nodes lies inside the body: a quadratic B-spline still moves on that
# plane, and the lattice yields like a body clamped 0.14 (tension) to 0.18 (bending) cells behind it
MARGIN_CELLS = 2  # beyond the last particle's cell: the reach of a quadratic B-spline and one to spare


def fit_grid(particles: Particles, *, dx: float, reach_m: float, clamped: bool) -> Grid:
    """The grid in which particles that move by at most `reach_m` [m] stay clear of the border.

    Held nodes are those up to `clamp_index`, the plane CLAMP_INSET cells beyond the clamped face x = 0. Across, nodes lie
    symmetrically about the body, on its surface where the extent is a whole number of cells. Behind a clamp nothing moves, so no room
    is left there.
    """
    x = particles.x_rest
    spacing = float(np.median(particles.volume)) ** (1 / 3)
    reach = int(np.ceil(reach_m / dx)) + MARGIN_CELLS
    first = np.floor(x[:, 0].min() / dx).astype(int) - (MARGIN_CELLS if clamped else reach)
    last = np.ceil(x[:, 0].max() / dx).astype(int) + reach
    origins, sizes = [(first + (CLAMP_INSET if clamped else 0.0)) * dx], [int(last - first + 1)]
    for axis in (1, 2):
        low, high = x[:, axis].min(), x[:, axis].max()
        cells = max(round((high - low + spacing) / dx), 1) + 2 * reach
        origins.append((low + high) / 2 - cells * dx / 2)
        sizes.append(cells + 1)
    return Grid(np.array(origins, float), dx, (sizes[0], sizes[1], sizes[2]), int(-first) if clamped else -1)


def held_by(grid: Grid, x_rest: np.ndarray) -> np.ndarray:
    """Which particles x_rest (P, 3) [m] the clamp holds, bool (P,): those whose nearest node along x is a held one.

    A quadratic B-spline gives held nodes more than half of such a particle, whether mass or force; what acts on it goes into the support.
    """
    nearest = np.rint((x_rest[:, 0] - grid.origin[0]) / grid.dx)
    return nearest <= grid.clamp_index


def spacing_of_nodes(body: Body, nodes: int, reach_m: float) -> float:
    """Cell size dx [m] at which the longest side of a grid around the body has `nodes` nodes at most, and three less at least.

    reach_m: how far its particles move at most [m], as `fit_grid` takes it.
    """
    sides = body.sides_m + reach_m * np.array([1 if body.clamped else 2, 2, 2])
    return float(max(sides) / (nodes - 2 * MARGIN_CELLS - 4))
