"""What is known of a scene whose answer is known: motion, surface, silhouette and volume (truth.npz of a clip folder)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RBFInterpolator

from diffphys_ros.types import Camera, Clip

NEIGHBOURS = 30  # vertices from which a surface point's displacement is interpolated


@dataclass(frozen=True)
class TrueScene:
    """Arrays of truth.npz at the T frames of a clip, which may have lost some of its frames."""

    positions: np.ndarray  # vertices [m], world, (T, N, 3)
    tets: np.ndarray  # vertices of each tetrahedron, (M, 4)
    part: np.ndarray  # of each tetrahedron, 0..n-1, (M,)
    mask: np.ndarray  # object, bool, (T, H, W)
    volume_m3: float

    @classmethod
    def of(cls, path: Path, clip: Clip) -> TrueScene:
        """The truth of a clip that begins with the truth's frame 0, whatever its clock."""
        with np.load(path) as truth:
            count = len(truth["positions"])
            index = np.clip(np.rint(clip.times * float(truth["fps"])).astype(int), 0, count - 1)
            shape = truth["mask_shape"]
            mask = np.unpackbits(truth["mask"])[: np.prod(shape)].reshape(shape).astype(bool)
            return cls(truth["positions"][index], truth["tets"], truth["tet_part"], mask[index], float(truth["vertex_volume"].sum()))

    def displacement(self, points: np.ndarray) -> np.ndarray:
        """Displacement (T, P, 3) [m] from frame 0 of material points (P, 3) [m] given where they are in frame 0."""
        moved = (self.positions - self.positions[0]).transpose(1, 0, 2).reshape(self.positions.shape[1], -1)
        found = RBFInterpolator(self.positions[0], moved, neighbors=NEIGHBOURS, degree=1)(points)
        return found.reshape(len(points), -1, 3).transpose(1, 0, 2)

    def surface_depth(self, camera: Camera) -> np.ndarray:
        """Depth (H, W) [m] of the object's surface in frame 0, 0 off the object."""
        image = self._drawn(camera, np.ones(len(self.tets), bool))
        return np.where(np.isfinite(image), image, 0.0)

    def surface_part(self, camera: Camera) -> np.ndarray:
        """Part 1..n (H, W) that is seen in frame 0, 0 off the object."""
        images = np.stack([self._drawn(camera, self.part == part) for part in range(int(self.part.max()) + 1)])
        return np.where(np.isfinite(images.min(0)), 1 + images.argmin(0), 0)

    def _drawn(self, camera: Camera, chosen: np.ndarray) -> np.ndarray:
        """Depth (H, W) [m] of some tetrahedra's surface in frame 0, infinite elsewhere."""
        pixels, depth = camera.project(self.positions[0])
        image = np.full((camera.height, camera.width), np.inf)
        for corners in _surface(self.tets[chosen]):
            _draw(image, pixels[corners], depth[corners])
        return image


def _surface(tets: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) that belong to one tetrahedron only."""
    faces = np.sort(tets[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3), axis=1)
    unique, count = np.unique(faces, axis=0, return_counts=True)
    return unique[count == 1]


def _draw(image: np.ndarray, pixels: np.ndarray, depth: np.ndarray) -> None:
    """Put a triangle of pixels (3, 2) and depths (3,) [m] into a depth image where it is nearer; inverse depth is linear on it."""
    low = np.maximum(np.ceil(pixels.min(0)).astype(int), 0)
    high = np.minimum(np.floor(pixels.max(0)).astype(int), (image.shape[1] - 1, image.shape[0] - 1))
    edges = (pixels[1:] - pixels[0]).T
    if (high < low).any() or abs(np.linalg.det(edges)) < 1e-9:
        return
    u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    share = np.linalg.solve(edges, np.stack([u.ravel() - pixels[0, 0], v.ravel() - pixels[0, 1]])).reshape(2, *u.shape)
    inside = (share >= -1e-9).all(0) & (share.sum(0) <= 1 + 1e-9)
    inverse = 1 / depth[0] + share[0] * (1 / depth[1] - 1 / depth[0]) + share[1] * (1 / depth[2] - 1 / depth[0])
    window = image[low[1] : high[1] + 1, low[0] : high[0] + 1]
    window[inside] = np.minimum(window[inside], 1 / inverse[inside])
