"""The filled solid of the object, from one view of it and what is known about the scene."""

from __future__ import annotations

import cv2
import numpy as np

from ..config import Scene, Settings
from ..errors import InputError
from ..types import IGNORE, Body, Clip
from .edges import coverage
from .frame import Clamp, body_pose, find_clamp, thickness_direction, up_direction
from .silhouette import (
    CELLS_PER_PIXEL,
    Raster,
    carved,
    nearest_filled,
    raster_over,
    reaching_clamp,
    smoothed,
    surface_height,
    tidy,
)

WATER_DENSITY = 1000.0  # kg/m^3, assumed where neither mass nor density is known
FLAT_SHARE = 0.08  # of the half thickness: a front that recedes by less is flat, the rest is noise of the depth
THINNEST = 0.15  # of the largest half thickness: a thinner rim is left out, it carries no load
HIDDEN_ROOT = 0.35  # of the length: at most so much of the root may hide behind the mount
ROOT_TOLERANCE_PX = 3.0  # gap at the clamp that is closed although nothing is seen to hide it
IN_FRONT = 0.01  # an occluder is nearer than the front by this share of the depth


def build_body(clip: Clip, depth0: np.ndarray, settings: Settings) -> Body:
    """The solid seen in frame 0: its silhouette along the thickness axis, extruded symmetrically to the mid-plane.

    The front comes from `depth0`; the unseen back is the front mirrored in the mid-plane half a thickness behind it. The thickness is
    `scene.thickness_m`, or the silhouette's own local width where that is not given. Needs `clip.labels`.

    Args:
        clip: recording with label images.
        depth0: the object's surface in frame 0 [m], 0 off the object, shape (H, W).
        settings: `scene.*`.

    Raises:
        InputError: nothing of the object near the clamp box, a density list that does not fit the parts, an object too small.
    """
    if clip.labels is None:
        raise ValueError("build_body needs clip.labels; run segment.label_clip first")
    scene, labels = settings.scene, clip.labels[0]
    mask = (labels > 0) & (labels != IGNORE) & (depth0 > 0)
    v, u = np.nonzero(mask)
    if len(v) < 16:
        raise InputError(f"{clip.source or 'clip'}: the object covers {len(v)} pixels with depth in frame 0, needs at least 16; give a larger scene.first_mask")
    surface = clip.camera.backproject(np.stack([u, v], -1).astype(float), depth0[v, u].astype(float))
    towards = thickness_direction(scene, clip.camera, surface)
    clamp = find_clamp(scene, surface, towards)
    pose = body_pose(clamp, surface, towards, up_direction(scene, clip.camera))
    footprint = float(np.median(depth0[v, u])) / clip.camera.focal_px
    seen = (surface - pose[:3, 3]) @ pose[:3, :3]
    raster = raster_over(seen, footprint / CELLS_PER_PIXEL, from_zero=clamp is not None)
    front = front_level(seen[:, 2], footprint)
    soft = coverage(clip.frames[0], mask)
    inside, half, middle = _solid(clip, scene, depth0, soft, raster, pose, front, footprint, clamp)
    part = _parts(labels, clip, raster, pose, inside, front)
    pose[:3, 3] += pose[:3, 2] * middle
    return _described(scene, clip, raster, pose, inside, half, part, clamp is not None)


def front_level(height: np.ndarray, footprint_m: float) -> float:
    """Height of the front face [m]: the median of the points near the top, so that specks in front do not count."""
    top = float(np.quantile(height, 0.985))
    return float(np.median(height[height > top - 3 * footprint_m]))


def _solid(clip: Clip, scene: Scene, depth0: np.ndarray, soft: np.ndarray, raster: Raster, pose: np.ndarray, front: float, footprint: float, clamp: Clamp | None) -> tuple[np.ndarray, np.ndarray, float]:
    """Silhouette (nx, ny), half thickness (nx, ny) [m] and the height of the mid-plane [m]."""
    if clip.depth is None:
        back = front - (scene.thickness_m or 0.0)
        inside, height = carved(raster, pose, clip.camera, soft, (front, back)), np.full(raster.shape, front)
    else:
        height, inside = surface_height(raster, pose, clip.camera, soft, depth0.astype(float), front, footprint)
    inside = tidy(inside & (front - height < (scene.thickness_m or np.inf) / 2))
    if not inside.any():
        raise InputError(f"{clip.source or 'clip'}: no part of the object faces scene.thickness_axis; correct the axis or the mask")
    if clamp:
        inside = _with_root(clip, raster, pose, inside, front, clamp)
    full = scene.thickness_m / 2 if scene.thickness_m else None
    half = np.full(raster.shape, full) if full else local_half_width(inside) * raster.pitch_m
    receding = np.clip(front - smoothed(height, inside), 0, None)
    half = half - np.where(receding > FLAT_SHARE * half, receding, 0.0)
    inside &= half > THINNEST * half.max()
    return inside, np.where(inside, half, 0.0), front - float(full if full else half[inside].max())


def _with_root(clip: Clip, raster: Raster, pose: np.ndarray, inside: np.ndarray, front: float, clamp: Clamp) -> np.ndarray:
    """The silhouette continued to the clamp plane within the box's width, where it is hidden or stops short by a few pixels."""
    y = raster.centres[0, :, 1]
    in_box = np.abs(y) <= np.abs(pose[:3, :3].T[1]) @ clamp.half_size
    hidden = np.ones(raster.shape, bool) if clip.depth is None else _occluded(clip, raster, pose, front)
    reach = round(HIDDEN_ROOT * float(np.flatnonzero(inside.any(1)).max()))
    grown = reaching_clamp(inside, hidden, reach=reach, tolerance=round(ROOT_TOLERANCE_PX * CELLS_PER_PIXEL))
    return np.where(in_box, grown, inside)


def _occluded(clip: Clip, raster: Raster, pose: np.ndarray, front: float) -> np.ndarray:
    """Cells (nx, ny) of the front plane before which something else stands."""
    assert clip.depth is not None
    cells = np.concatenate([raster.centres, np.full((*raster.shape, 1), front)], -1)
    pixels, depth = clip.camera.project(cells @ pose[:3, :3].T + pose[:3, 3])
    measured = cv2.remap(clip.depth[0], pixels.astype(np.float32), None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return (measured > 0) & (measured < (1 - IN_FRONT) * depth)


def local_half_width(inside: np.ndarray) -> np.ndarray:
    """Radius of the largest disc inside the silhouette that covers each cell [cells], shape (nx, ny) (local thickness)."""
    radius = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    ridge = (radius >= cv2.dilate(radius, np.ones((3, 3), np.uint8)) - 1e-6) & inside
    width = radius.copy()
    centres = np.argwhere(ridge)
    for i, j in centres[np.argsort(radius[ridge], kind="stable")]:
        cv2.circle(width, (int(j), int(i)), int(radius[i, j]), float(radius[i, j]), -1)
    return np.where(inside, width, 0.0)


def _parts(labels: np.ndarray, clip: Clip, raster: Raster, pose: np.ndarray, inside: np.ndarray, front: float) -> np.ndarray:
    """Part numbers (nx, ny) uint8 read from the label image under the front, extended to the nearest part."""
    cells = np.concatenate([raster.centres, np.full((*raster.shape, 1), front)], -1)
    pixels, _ = clip.camera.project(cells @ pose[:3, :3].T + pose[:3, 3])
    value = cv2.remap(labels, pixels.astype(np.float32), None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    known = inside & (value > 0) & (value != IGNORE)
    return nearest_filled(value, known) if known.any() else np.ones(raster.shape, np.uint8)


def _described(scene: Scene, clip: Clip, raster: Raster, pose: np.ndarray, inside: np.ndarray, half: np.ndarray, part: np.ndarray, clamped: bool) -> Body:
    parts = max(int(part[inside].max()), 1)
    volumes = np.array([(half * inside * (part == k + 1)).sum() for k in range(parts)]) * 2 * raster.pitch_m**2
    density, density_source = part_densities(scene, volumes)
    gravity = np.array(scene.gravity_m_s2 or (0.0, 0.0, 0.0)) @ pose[:3, :3]
    return Body(
        world_from_body=pose,
        inside=inside,
        origin=raster.origin,
        pitch_m=raster.pitch_m,
        half_thickness=half,
        part=part,
        density=density,
        poisson=_per_part(scene.poisson_ratio, parts, "scene.poisson_ratio"),
        gravity=gravity,
        clamped=clamped,
        sources={"density": density_source, "metric_scale": _metric_scale(scene, clip), "thickness": "thickness_m" if scene.thickness_m else "the mask's own width"},
    )


def part_densities(scene: Scene, volumes: np.ndarray) -> tuple[np.ndarray, str]:
    """Density per part [kg/m^3] of parts with these volumes [m^3], and what fixed it."""
    if scene.density_kg_m3 is not None:
        density = _per_part(scene.density_kg_m3, len(volumes), "scene.density_kg_m3")
        if scene.mass_kg is None:
            return density, "density_kg_m3"
        return density * scene.mass_kg / float(density @ volumes), "density_kg_m3 scaled to mass_kg"
    if scene.mass_kg is not None:
        return np.full(len(volumes), scene.mass_kg / volumes.sum()), "mass_kg over the filled volume"
    return np.full(len(volumes), WATER_DENSITY), f"assumed: {WATER_DENSITY:g} kg/m^3"


def _per_part(values: list[float], parts: int, name: str) -> np.ndarray:
    if len(values) not in (1, parts):
        raise InputError(f"{name} has {len(values)} values, must be 1 or {parts} (one per part found); correct the list or segment.max_parts")
    return np.broadcast_to(np.array(values, float), (parts,)).copy()


def _metric_scale(scene: Scene, clip: Clip) -> str:
    if clip.depth is not None:
        return "depth topic"
    if scene.clamp_box_m is not None and scene.thickness_axis is not None and clip.camera.pose_known:
        return "clamp_box_m and the camera's pose"
    return "assumed: the object is 1 m away"
