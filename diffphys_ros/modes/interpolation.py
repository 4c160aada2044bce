"""Quadratic shape functions on straight tetrahedra: values and gradients at any point. numpy and scipy only.

Local nodes: the four corners, then the middles of EDGES (Zienkiewicz, The Finite Element Method, quadratic tetrahedron).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
CANDIDATES = 32  # nearest elements that are searched for the one that holds a point [numerical]
GAUSS = np.full((4, 4), 0.1381966011250105) + 0.4472135954999580 * np.eye(4)  # barycentric coordinates of the 4-point rule, exact for quadratics


@dataclass(frozen=True)
class Location:
    """Where M points lie in a mesh. Points outside are represented by the nearest point of an element and an offset."""

    element: np.ndarray  # (M,)
    barycentric: np.ndarray  # inside or on the element, (M, 4)
    offset: np.ndarray  # point minus its representative [m], (M, 3); zero inside


def barycentric_gradients(corners: np.ndarray) -> np.ndarray:
    """Gradients [1/m] (..., 4, 3) of the barycentric coordinates of tetrahedra with corners (..., 4, 3) [m]."""
    inverse = np.linalg.inv(corners[..., 1:, :] - corners[..., :1, :])
    rest = np.swapaxes(inverse, -1, -2)
    return np.concatenate([-rest.sum(-2, keepdims=True), rest], -2)


def locate(nodes: np.ndarray, tets: np.ndarray, points: np.ndarray) -> Location:
    """Elements that hold points (M, 3), or are nearest to them; nodes (N, 3), tets (E, 10)."""
    corners = nodes[tets[:, :4]]
    gradients = barycentric_gradients(corners)
    _, near = cKDTree(corners.mean(1)).query(points, k=min(CANDIDATES, len(tets)))
    near = near.reshape(len(points), -1)
    offset = points[:, None] - corners[near, 0]
    weights = np.einsum("mkai,mki->mka", gradients[near], offset)
    weights[..., 0] += 1.0
    best = weights.min(-1).argmax(-1)
    rows = np.arange(len(points))
    element, weight = near[rows, best], weights[rows, best]
    inside = np.clip(weight, 0.0, None)
    inside /= inside.sum(-1, keepdims=True)
    inside = np.where((weight >= -1e-9).all(-1, keepdims=True), weight, inside)
    return Location(element, inside, points - np.einsum("ma,mai->mi", inside, corners[element]))


def shape_functions(barycentric: np.ndarray) -> np.ndarray:
    """Values (..., 10) at barycentric coordinates (..., 4)."""
    a, b = (barycentric[..., [edge[i] for edge in EDGES]] for i in (0, 1))
    return np.concatenate([barycentric * (2 * barycentric - 1), 4 * a * b], -1)


def shape_gradients(barycentric: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Gradients [1/m] (..., 10, 3) at barycentric coordinates (..., 4) with gradients (..., 4, 3)."""
    first, second = [edge[0] for edge in EDGES], [edge[1] for edge in EDGES]
    corner = (4 * barycentric - 1)[..., None] * gradients
    middle = 4 * (barycentric[..., first, None] * gradients[..., second, :] + barycentric[..., second, None] * gradients[..., first, :])
    return np.concatenate([corner, middle], -2)


def evaluate(nodes: np.ndarray, tets: np.ndarray, field: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (M, ...) and gradients (M, 3, ...) [1/m] at points (M, 3) [m] of a nodal field (N, ...).

    Outside the mesh the field continues linearly from the nearest element.
    """
    where = locate(nodes, tets, points)
    value, slope = _inside(nodes, tets[where.element], where.barycentric, field)
    return value + np.einsum("mi,mi...->m...", where.offset, slope), slope


def quadrature(nodes: np.ndarray, tets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (4E, 3) [m], volumes (4E,) [m^3] and shape functions (4E, 10) of the 4-point rule on every element."""
    corners = nodes[tets[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    points = np.einsum("ga,eai->egi", GAUSS, corners).reshape(-1, 3)
    return points, np.repeat(volume / 4, 4), np.tile(shape_functions(GAUSS), (len(tets), 1))


def at_quadrature(nodes: np.ndarray, tets: np.ndarray, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What `evaluate` gives at the points of `quadrature`, without a search for their elements."""
    return _inside(nodes, np.repeat(tets, 4, 0), np.tile(GAUSS, (len(tets), 1)), field)


def _inside(nodes: np.ndarray, tets: np.ndarray, barycentric: np.ndarray, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (M, ...) and gradients (M, 3, ...) of a nodal field in elements (M, 10) at barycentric coordinates (M, 4)."""
    gradients = shape_gradients(barycentric, barycentric_gradients(nodes[tets[:, :4]]))
    flat = field.reshape(len(field), -1)[tets]
    value = np.einsum("mn,mnf->mf", shape_functions(barycentric), flat)
    slope = np.einsum("mni,mnf->mif", gradients, flat)
    return value.reshape(-1, *field.shape[1:]), slope.reshape(-1, 3, *field.shape[1:])
