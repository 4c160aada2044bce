"""From pixels to points in the world."""

from __future__ import annotations

import numpy as np

from ..matching import neighbour_median
from ..surface_plane import plane_depth
from ..types import Camera, Clip

LEAST_SUPPORT = 0.25  # share of the depth window that must lie on the local plane
LARGEST_ODDITY = 6.0  # of a displacement from its neighbours' median, in robust standard deviations over all points
LARGEST_MOTION = 6.0  # of a displacement, in 0.9-quantiles of all displacements of the clip
LEAST_STEEPNESS = 0.02  # sine of the angle between a ray and its point's plane, below which where they meet is noise
LARGEST_OFFSET = 0.01  # of a frame-0 depth from the object's surface, as a share of the depth


def points_from_depth(clip: Clip, pixels: np.ndarray, valid: np.ndarray, depth0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World points (T, M, 3) [m] by the depth of a local plane in every frame, and what of `valid` (T, M) survives."""
    assert clip.depth is not None
    points = np.empty((*valid.shape, 3))
    valid = valid.copy()
    for k, depth in enumerate(clip.depth):
        z, support = plane_depth(depth, pixels[k].astype(float))
        valid[k] &= (z > 0) & (support > LEAST_SUPPORT)
        points[k] = clip.camera.backproject(pixels[k].astype(float), np.where(valid[k], z, _at(depth0, pixels[0])))
    surface = _at(depth0, pixels[0])
    z0 = plane_depth(clip.depth[0], pixels[0].astype(float))[0]
    on_surface = (surface > 0) & (np.abs(z0 - surface) < LARGEST_OFFSET * surface)
    return points, valid & on_surface


def points_on_planes(camera: Camera, pixels: np.ndarray, valid: np.ndarray, depth0: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World points (T, M, 3) [m] where the pixel rays meet the plane across `normal` through each frame-0 point.

    Used without a depth topic: motion along the line of sight is not seen, so a point may be off along its own ray; compare only
    the components across that ray with a model.
    """
    surface = _at(depth0, pixels[0])
    start = camera.backproject(pixels[0].astype(float), surface)
    rays = camera.rays(pixels.astype(float))
    height, steepness = (start - camera.position) @ normal, rays @ normal
    met = np.abs(steepness) > LEAST_STEEPNESS * np.linalg.norm(rays, axis=-1)
    met &= met[:1] & (steepness * steepness[:1] > 0)  # a ray along the plane meets it nowhere, one from its other side behind the camera
    points = camera.position + rays * np.where(met, height / np.where(met, steepness, 1.0), surface)[..., None]
    return points, valid & (surface > 0) & met


def without_oddities(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """What of `valid` (T, M) remains when displacements (T, M, 3) far from their neighbours' are dropped.

    Catches wrong depths (an edge, the background behind it) that look right in the image, and those of whole patches by the size of
    their motion.
    """
    if not valid.any():
        return valid
    distance = np.linalg.norm(points - points[0], axis=-1)
    kept = valid & (distance <= max(LARGEST_MOTION * float(np.quantile(distance[valid], 0.9)), 1e-9))
    for k in range(1, len(points)):
        displacement = points[k] - points[0]
        off = np.linalg.norm(displacement - neighbour_median(points[0], displacement, kept[k]), axis=1)
        if kept[k].any():
            kept[k] &= off <= LARGEST_ODDITY * max(float(np.median(off[kept[k]])), 1e-9) / 0.6745
    return kept


def _at(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    index = np.rint(pixels).astype(int)
    return image[index[:, 1], index[:, 0]].astype(float)
