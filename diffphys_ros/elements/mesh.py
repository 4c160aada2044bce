"""Tetrahedral mesh of a Body: its outline triangulated, extruded through the half thickness. scipy.spatial only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay, cKDTree

from ..errors import InputError
from ..types import Body
from .outline import boundary_loops, interface_lines, smooth_loop

TRIANGLE_VERTICES = 90  # aimed at in the plane; twice as many layers of nodes as LAYERS + 1 with quadratic elements [numerical]
CELLS_ACROSS = 3.0  # elements across the narrowest limb, at the least: two leave a frequency of a leaf on a stalk 1.2 % high, three 0.4 % [docs/measurements/sensitivity.md]
MOST_VERTICES = 600  # in the plane [numerical]
LAYERS = 2  # elements through the thickness [tests/elements/test_assemble.py]
CLEARANCE = 0.62  # distance of inner points from lines, in element sizes [numerical]
ROOT = 0.2  # of the length, that is stretched where the held face moves: several elements [numerical]
SMOOTHING_ROUNDS = 6  # of the inner points, towards their neighbours [numerical]


@dataclass(frozen=True)
class SolidMesh:
    """Linear tetrahedra."""

    vertices: np.ndarray  # body frame [m], shape (V, 3)
    tets: np.ndarray  # vertex numbers, shape (M, 4)
    part: np.ndarray  # 1..n, shape (M,)
    clamped: bool  # whether the vertices at x = held_x_m are held
    held_x_m: float = 0.0

    @property
    def volume_m3(self) -> float:
        """Volume [m^3]."""
        corners = self.vertices[self.tets]
        return float(np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6)

    def held_behind(self, distance_m: float) -> SolidMesh:
        """The same with its held face so far out along -x, to which what is nearest to it is stretched: as the body goes on straight."""
        x = self.vertices[:, 0]
        stretched = x - distance_m * np.clip(1 - x / (ROOT * x.max()), 0, 1)
        return replace(self, vertices=np.column_stack([stretched, self.vertices[:, 1:]]), held_x_m=self.held_x_m - distance_m)


def solid_mesh(body: Body, size_m: float | None = None) -> SolidMesh:
    """Mesh of the filled body with elements of about `size_m` (chosen from the body's outline where left out)."""
    size = size_m or element_size(body)
    points, triangles = triangulate(body, size)
    height = _half_thickness(body, points, size)
    vertices, tets = extrude(points, triangles, height)
    part = body.part_at(points[triangles].mean(1))
    return SolidMesh(vertices, tets, np.tile(np.repeat(part, 3), LAYERS).astype(int), body.clamped)


def element_size(body: Body) -> float:
    """Side of a triangle [m]: a set number over the area, finer where a limb is narrow."""
    region = _region(body)
    area = region.sum() * body.pitch_m**2
    if area == 0:
        raise InputError("the silhouette of the body is empty; correct the object mask or scene.clamp_box_m")
    side = np.sqrt(area / TRIANGLE_VERTICES / 0.866)
    narrow = narrowest_limb(region) * body.pitch_m
    return float(max(min(side, narrow / CELLS_ACROSS), np.sqrt(area / MOST_VERTICES / 0.866)))


def narrowest_limb(region: np.ndarray) -> float:
    """Width [cells] of the narrowest long limb: the 10th percentile of twice the distance to the outside on the medial axis."""
    from scipy.ndimage import distance_transform_edt, maximum_filter

    distance = distance_transform_edt(np.pad(region, 1))
    axis = (distance >= maximum_filter(distance, 3) - 0.5) & (distance > 0.25 * distance.max())
    return float(2 * np.percentile(distance[axis], 10))


def triangulate(body: Body, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) [m] and triangles (m, 3) of the outline; lines between parts lie on triangle sides."""
    region = _region(body)
    spacing = size / body.pitch_m
    loops = [np.vstack([p[:-1] for p in smooth_loop(loop, spacing, _held(loop, body))]) for loop in boundary_loops(region) if len(loop) > 3 * spacing]
    loops = [loop for loop in loops if len(loop) > 2]
    if not loops:
        raise InputError("the silhouette of the body is smaller than one element; film the object larger or correct the mask")
    outline = [_snapped(body.origin + loop * body.pitch_m, body) for loop in loops]
    inner = [body.origin + line * body.pitch_m for line in interface_lines(body.part, region, spacing)]
    fixed, sides = _constraints(outline, inner, size)
    loose = _inner_points(outline, fixed, size)
    for _ in range(SMOOTHING_ROUNDS):
        loose = _relaxed(fixed, loose, outline)
    return _cut(fixed, loose, sides, outline, size)


def _region(body: Body) -> np.ndarray:
    if not body.clamped:
        return body.inside
    return body.inside & (np.arange(len(body.inside)) >= _first_row(body))[:, None]


def _first_row(body: Body) -> int:
    """Of cells whose centres lie beyond x = 0."""
    return int((body.origin[0] + np.arange(len(body.inside)) * body.pitch_m <= 0).sum())


def _held(loop: np.ndarray, body: Body) -> np.ndarray:
    """Which midpoints (k, 2) of a region's sides [cells] lie on the clamped face, (k,)."""
    return np.asarray(body.clamped & (loop[:, 0] < _first_row(body) - 0.25))


def _snapped(points: np.ndarray, body: Body) -> np.ndarray:
    """The clamped face exactly on x = 0."""
    near = body.clamped & (points[:, 0] < 1.5 * body.pitch_m)
    return np.stack([np.where(near, 0.0, points[:, 0]), points[:, 1]], 1)


def _constraints(outline: list[np.ndarray], inner: list[np.ndarray], size: float) -> tuple[np.ndarray, np.ndarray]:
    """All line points (n, 2) and the pairs (s, 2) of them that must be triangle sides."""
    points, sides, count = list(outline), [], 0
    for loop in outline:
        n = len(loop)
        sides.append(count + np.stack([np.arange(n), np.roll(np.arange(n), -1)], 1))
        count += n
    border = cKDTree(np.vstack(outline))
    for line in inner:
        line = line[border.query(line)[0] > 0.5 * size]
        points.append(line)
        sides.append(count + np.stack([np.arange(len(line) - 1), np.arange(1, len(line))], 1).reshape(-1, 2))
        count += len(line)
    return np.vstack(points), np.vstack(sides)


def _inner_points(outline: list[np.ndarray], fixed: np.ndarray, size: float) -> np.ndarray:
    """Hexagonal lattice inside the outline, clear of all lines."""
    low, high = fixed.min(0), fixed.max(0)
    y, x = np.arange(low[1] + 0.3 * size, high[1], 0.866 * size), np.arange(low[0] + 0.3 * size, high[0], size)
    lattice = np.stack([x[None, :] + 0.5 * size * (np.arange(len(y)) % 2)[:, None], np.repeat(y[:, None], len(x), 1)], -1).reshape(-1, 2)
    clear = cKDTree(fixed).query(lattice)[0] > CLEARANCE * size
    return lattice[clear & contains(outline, lattice)]


def _relaxed(fixed: np.ndarray, loose: np.ndarray, outline: list[np.ndarray]) -> np.ndarray:
    """Inner points moved to the mean of their neighbours."""
    if not len(loose):
        return loose
    points = np.vstack([fixed, loose])
    first, neighbours = Delaunay(points).vertex_neighbor_vertices
    moved = np.array([points[neighbours[first[k] : first[k + 1]]].mean(0) for k in range(len(fixed), len(points))])
    return np.where(contains(outline, moved)[:, None], moved, loose)


def _cut(fixed: np.ndarray, loose: np.ndarray, sides: np.ndarray, outline: list[np.ndarray], size: float) -> tuple[np.ndarray, np.ndarray]:
    """Delaunay triangles inside the outline; missing sides are halved until all are there."""
    for _ in range(4):
        points = np.vstack([fixed, loose])
        triangles = Delaunay(points).simplices
        present = {tuple(sorted(e)) for t in triangles.tolist() for e in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}
        missing = np.array([tuple(sorted(s)) not in present for s in sides.tolist()])
        if not missing.any():
            break
        middle = 0.5 * (fixed[sides[missing, 0]] + fixed[sides[missing, 1]])
        new = len(fixed) + np.arange(len(middle))
        sides = np.vstack([sides[~missing], np.stack([sides[missing, 0], new], 1), np.stack([new, sides[missing, 1]], 1)])
        fixed = np.vstack([fixed, middle])
    corner = points[triangles]
    area = 0.5 * np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1]))
    triangles = triangles[(area > 1e-3 * size**2) & contains(outline, corner.mean(1))]
    used, number = np.unique(triangles, return_inverse=True)
    return points[used], number.reshape(-1, 3)


def contains(outline: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Which points (n, 2) lie inside closed polylines, by even-odd crossings, shape (n,)."""
    odd = np.zeros(len(points), bool)
    for loop in outline:
        a, b = loop, np.roll(loop, -1, 0)
        above = (a[None, :, 1] > points[:, None, 1]) != (b[None, :, 1] > points[:, None, 1])
        rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
        x = a[:, 0] + (points[:, None, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
        odd ^= (above & (points[:, None, 0] < x)).sum(1) % 2 == 1
    return odd


def _half_thickness(body: Body, points: np.ndarray, size: float) -> np.ndarray:
    """Half thickness [m] (n,) at plane points: averaged over a third of an element inside the silhouette, so that a
    sharp rim is as thick as it is there in the mean."""
    sigma = size / body.pitch_m / 3
    weight = gaussian_filter(body.inside.astype(float), sigma)
    smooth = gaussian_filter(np.where(body.inside, body.half_thickness, 0.0), sigma) / np.maximum(weight, 1e-9)
    return smooth[body.cell_of(points)]


def extrude(points: np.ndarray, triangles: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and tetrahedra (M, 4): LAYERS of prisms between z = -height and height, three tetrahedra each.

    The prism's corners are taken in the order of the plane's numbers, so that neighbours cut their common face alike.
    """
    levels = np.linspace(-1, 1, LAYERS + 1)
    vertices = np.vstack([np.column_stack([points, level * height]) for level in levels])
    a, b, c = np.sort(triangles, 1).T
    tets = []
    for layer in range(LAYERS):
        low, up = layer * len(points), (layer + 1) * len(points)
        split = [[a + low, b + low, c + low, c + up], [a + low, b + low, b + up, c + up], [a + low, a + up, b + up, c + up]]
        tets.append(np.stack([np.stack(s, 1) for s in split], 1).reshape(-1, 4))
    return vertices, _oriented(vertices, np.vstack(tets))


def _oriented(vertices: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Tetrahedra of positive volume."""
    side = vertices[tets[:, 1:]] - vertices[tets[:, :1]]
    flip = np.linalg.det(side) < 0
    tets = tets.copy()
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    return tets
