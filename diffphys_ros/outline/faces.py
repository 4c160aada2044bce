"""The visible surface of a plain object before a depth camera: how far it lies along its own normals of frame 0. This is what an outline does not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..surface_plane import Planes, planes_at
from ..types import Camera, Clip, Tracks, object_mask
from .follow import GROSS, LEAST_SHARE, SPACING_PX, smooth, spread_of

RADIUS_PX = 5  # half side of the window that a plane is laid through [chosen]
FLAT_SHARE, SEEN_SHARE = 0.9, 0.5  # of the window that must lie on the plane, in frame 0 and in a later one [chosen]
TURN_COSINE = np.cos(np.radians(30.0))  # of a surface that has turned further: it is another face [chosen]
MOST_FACES = 120  # points on the surface [numerical]
LEAST_FACING = 0.5  # cosine between the normal and the line of sight [chosen]


def with_faces(clip: Clip, tracks: Tracks) -> Tracks:
    """The tracks of an outline, and points on the surface inside it that are seen along its normals; `tracks` itself where no depth shows any. Needs
    `clip.labels`."""
    if clip.depth is None or clip.labels is None:
        return tracks
    masks = object_mask(clip.labels)
    planes, points = _flat(clip, masks[0])
    if not len(points):
        return tracks
    normals = _normals(planes, clip.camera)
    moved = np.stack([_moved(depth, mask, planes.pixels, points, normals, clip.camera) for depth, mask in zip(clip.depth, masks, strict=True)])
    moved = np.where(clip.seen[:, None], moved, np.nan)
    held = np.isfinite(moved[clip.seen]).mean(0) > LEAST_SHARE
    return _joined(tracks, points[held], normals[held], moved[:, held], clip.camera) if held.any() else tracks


def _flat(clip: Clip, mask: np.ndarray) -> tuple[Planes, np.ndarray]:
    """Where the surface of frame 0 is flat and turned to the camera: its planes, and points (P, 3) on them, world."""
    assert clip.depth is not None
    planes, share = planes_at(clip.depth[0], _grid(mask), radius=RADIUS_PX, mask=mask)
    points = clip.camera.backproject(planes.pixels, planes.depth)
    sight = points - clip.camera.position
    facing = -(_normals(planes, clip.camera) * sight).sum(1) > LEAST_FACING * np.linalg.norm(sight, axis=1)
    kept = (share >= FLAT_SHARE) & facing
    return planes.only(kept), points[kept]


def _normals(planes: Planes, camera: Camera) -> np.ndarray:
    """Unit vectors (P, 3), world, towards the camera."""
    vectors = planes.in_world(camera)
    return np.asarray(-vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _grid(mask: np.ndarray) -> np.ndarray:
    """Pixels (P, 2) of the object, evenly spaced."""
    spacing = max(SPACING_PX, float(np.sqrt(mask.sum() / MOST_FACES)))
    height, width = mask.shape
    rows, columns = (np.arange(spacing / 2, n, spacing) for n in (height, width))
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).round()
    return pixels[mask[tuple(pixels[:, ::-1].astype(int).T)]]


def _moved(depth: np.ndarray, mask: np.ndarray, pixels: np.ndarray, points: np.ndarray, normals: np.ndarray, camera: Camera) -> np.ndarray:
    """How far along their normals the surface in a depth image lies from points (P,) [m]; NaN where it is not seen there, or another face is."""
    planes, share = planes_at(depth, pixels, radius=RADIUS_PX, mask=mask)
    plane, turned = planes.in_world(camera), (_normals(planes, camera) * normals).sum(1)
    known = (share >= SEEN_SHARE) & (turned >= TURN_COSINE)
    off = (1 - ((points - camera.position) * plane).sum(1)) / np.where(known, (plane * normals).sum(1), 1.0)
    return np.where(known, off, np.nan)


def _joined(tracks: Tracks, points: np.ndarray, normals: np.ndarray, moved: np.ndarray, camera: Camera) -> Tracks:
    """Tracks with points (P, 3) as well that moved (T, P) [m] along their normals; NaN where that is not seen."""
    assert tracks.normals is not None
    assert tracks.sd_m is not None
    moved = moved - np.nan_to_num(moved[0])
    spread = spread_of(moved, least=0.0)
    moved = np.where(np.abs(moved - smooth(moved)) <= GROSS * np.maximum(spread, 1e-9), moved, np.nan)
    moved[0] = 0.0
    valid = np.isfinite(moved)
    places = points + np.nan_to_num(moved)[..., None] * normals
    sd = np.repeat(np.where(valid, spread, np.inf)[..., None], 2, -1)
    sd[0] = 0.0
    return replace(
        tracks,
        pixels=np.concatenate([tracks.pixels, camera.project(places)[0]], 1),
        points=np.concatenate([tracks.points, places], 1),
        valid=np.concatenate([tracks.valid, valid], 1),
        sd_m=np.concatenate([tracks.sd_m, sd], 1),
        normals=np.concatenate([tracks.normals, normals]),
    )
