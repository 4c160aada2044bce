"""Gaussians of the whole still scene, and those of them that are the object (paper section 4.1)."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..config import Settings
from ..splats import View, fit_views, from_points
from ..types import IGNORE, Camera, Splats
from .views import Shot

ON_SURFACE = 0.02  # share of the depth by which a seed may lie off the surface of frame 0
LINK = 0.04  # share of the object's extent up to which two points belong together
THROUGH = 0.4  # the same where its front and its back may show points and its sides none
FAR = 3.0  # quantile distances from the middle beyond which sparse points start no Gaussian


def scene_gaussians(
    shots: Sequence[Shot], cameras: Sequence[Camera], points: np.ndarray, colors: np.ndarray, settings: Settings, device: str
) -> Generator[tuple[int, int, float], None, Splats]:
    """Gaussians of all that the pictures show, from sparse points (N, 3) [m] and their colours; yields (iteration, iterations, loss)."""
    views = [_view(shot, camera) for shot, camera in zip(shots, cameras, strict=True)]
    near = _near(points)
    return (yield from fit_views(views, from_points(points[near], colors[near]), settings, device, count=settings.capture.max_gaussians))


def _view(shot: Shot, camera: Camera) -> View:
    labels = None if shot.valid.all() else np.where(shot.valid, 1, IGNORE).astype(np.uint8)
    return View(shot.image, camera, labels)


def _near(points: np.ndarray) -> np.ndarray:
    """Points (N,) that are no strays far out."""
    distance = np.linalg.norm(points - np.median(points, 0), axis=1)
    return distance <= FAR * np.quantile(distance, 0.9)


def part_of_object(points: np.ndarray, camera: Camera, mask: np.ndarray, depth: np.ndarray, *, link: float = LINK) -> np.ndarray:
    """Which points (N, 3) [m, world] are the object that frame 0 shows, bool (N,).

    Those behind the mask (H, W), of them the ones that hang together with the visible surface, whose depth (H, W) [m, 0 where unknown]
    is given: the sides and the back come along, the scene behind does not.
    """
    pixels, z = camera.project(points)
    inside = (z > 0) & (pixels >= -0.5).all(1) & (pixels < np.array(mask.shape[::-1]) - 0.5).all(1)
    u, v = np.rint(np.where(inside[:, None], pixels, 0)).astype(int).T
    inside &= mask[v, u]
    chosen = np.flatnonzero(inside)
    front = depth[v, u][chosen]
    seeds = (front > 0) & (np.abs(z[chosen] - front) < ON_SURFACE * np.maximum(front, 1e-9))
    found = np.zeros(len(points), bool)
    if seeds.any():
        reach = link * float(np.linalg.norm(np.ptp(points[chosen][seeds], axis=0)))
        pairs = cKDTree(points[chosen]).sparse_distance_matrix(cKDTree(points[chosen]), reach)
        group = connected_components(pairs, directed=False)[1]
        found[chosen[np.isin(group, np.unique(group[seeds]))]] = True
    return found


def pick(splats: Splats, chosen: np.ndarray) -> Splats:
    """The Gaussians at a mask (G,)."""
    return replace(splats, **{name: value[chosen] for name, value in vars(splats).items()})
