"""The body's own frame: x out of the clamp, z along the thickness axis towards the camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..picture import on_plane, side_of
from ..types import Camera

INSET_M = 0.005  # the clamped plane lies this far inside the box face through which the body leaves
LEAST_FREE = 0.25  # of the visible surface that has to lie beyond the clamped plane: what lies behind it is no part of the body
NEAR_LINE = 0.05  # of the visible surface: what lies nearest to a line in the picture says how far away that is
CLEARLY_FREE = 0.6  # of the visible surface that has to lie on one side of such a line: which side is held would be a guess
LARGEST_GAP = 0.15  # between the clamped plane and the nearest visible point, as a share of the object's extent


@dataclass(frozen=True)
class Clamp:
    """Where the body is held."""

    centre: np.ndarray  # of the clamped face, world [m], shape (3,)
    normal: np.ndarray  # world axis along which the body leaves, shape (3,)
    half_size: np.ndarray  # of the box [m], shape (3,)
    told: str  # the setting and its value, for messages
    drawn: bool = False  # as a line in the picture, beyond which the body goes on straight; false: as a box

    @property
    def reach_m(self) -> float:
        """How far the box goes on beyond the clamped plane [m]; 0 for a line."""
        return 0.0 if self.drawn else min(INSET_M, float(np.abs(self.normal) @ self.half_size))


def find_clamp(scene: Scene, camera: Camera, surface: np.ndarray, towards_camera: np.ndarray, behind_px: float = 0.0) -> Clamp | None:
    """The clamped plane of `scene.clamp_box_m` or `scene.clamp_px`, or None without either.

    The body leaves through the face with the most of the visible surface (world points (P, 3) [m]) straight in front of it; faces
    across the line of sight (`towards_camera`, unit vector) are left out. The plane lies 5 mm inside that face, at most at the
    middle of the box. A line of the picture is the plane itself, or the plane lies `behind_px`
    behind it. Raises InputError for a box that is no box, or with nothing of the object
    near it.
    """
    if scene.clamp_px is not None:
        return _on_line(scene.clamp_px, camera, surface, towards_camera, behind_px)
    if scene.clamp_box_m is None:
        return None
    low, high = np.reshape(np.array(scene.clamp_box_m, float), (2, 3))
    if not (low < high).all():
        raise InputError(f"scene.clamp_box_m {scene.clamp_box_m}: each maximum must exceed its minimum; give xmin ymin zmin xmax ymax zmax")
    axis, side = max(_faces(towards_camera), key=lambda face: _leaving(surface, low, high, *face))
    normal = np.zeros(3)
    normal[axis] = side
    centre = (low + high) / 2
    centre[axis] = high[axis] - min(INSET_M, (high - low)[axis] / 2) if side > 0 else low[axis] + min(INSET_M, (high - low)[axis] / 2)
    clamp = Clamp(centre, normal, (high - low) / 2, f"scene.clamp_box_m {scene.clamp_box_m}")
    _require_object(clamp, surface, "move the box onto the held face (world frame, metres) or leave it out", "draw the box around the held end alone", LEAST_FREE)
    return clamp


def _on_line(line_px: list[float], camera: Camera, surface: np.ndarray, towards_camera: np.ndarray, behind_px: float) -> Clamp:
    """The plane along the line of sight through a line of the picture at the object's distance, or so far behind it [px]; the body leaves to
    where most of it lies."""
    pixels = camera.project(surface)[0]
    middle = np.reshape(line_px, (2, 2)).mean(0)
    away = np.abs(side_of(line_px, pixels)) + 1e-6 * np.linalg.norm(pixels - middle, axis=1)
    near = surface[away <= np.quantile(away, NEAR_LINE)]
    ends = on_plane(camera, np.reshape(line_px, (2, 2)), np.median(near, 0), towards_camera)
    normal = _unit(np.cross(towards_camera, ends[1] - ends[0]))
    normal *= np.sign(np.median((surface - ends[0]) @ normal)) or 1.0
    clamp = Clamp(ends.mean(0), normal, np.abs(ends[1] - ends[0]) / 2, f"scene.clamp_px {line_px}", drawn=True)
    _require_object(clamp, surface, "move the line onto the held end or leave it out", "draw the line along the held end", CLEARLY_FREE)
    footprint = float(camera.project(clamp.centre)[1]) / camera.focal_px
    return replace(clamp, centre=clamp.centre - normal * behind_px * footprint)


def body_pose(clamp: Clamp | None, surface: np.ndarray, towards_camera: np.ndarray, upwards: np.ndarray) -> np.ndarray:
    """world_from_body (4, 4) with the origin still on the front: only the axes and the origin's x and y are final."""
    x = clamp.normal if clamp else upwards
    x = _unit(x - (x @ towards_camera) * towards_camera)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(towards_camera, x), towards_camera], -1)
    pose[:3, 3] = clamp.centre if clamp else np.median(surface, 0)
    if clamp is None:
        pose[:3, 3] += x * ((surface - pose[:3, 3]) @ x).min()
    return pose


def leaning(pose: np.ndarray, lean: float) -> np.ndarray:
    """world_from_body (4, 4) whose plane x = 0 is turned about z, as the line x = tan(lean) y."""
    turned = pose.copy()
    x, y = pose[:3, 0], pose[:3, 1]
    turned[:3, 0], turned[:3, 1] = np.cos(lean) * x - np.sin(lean) * y, np.sin(lean) * x + np.cos(lean) * y
    return turned


def thickness_direction(scene: Scene, camera: Camera, surface: np.ndarray) -> np.ndarray:
    """Unit vector (3,) along which the thickness is measured, pointing towards the camera; the optical axis where none is given."""
    axis = -camera.world_from_camera[:3, 2]
    if scene.thickness_unit is not None and camera.pose_known:
        axis = np.array(scene.thickness_unit)
    if not axis.any():
        raise InputError(f"scene.thickness_axis {scene.thickness_axis}: its length is 0, must be positive; give a world axis such as [0, 1, 0]")
    axis = _unit(axis)
    towards = (camera.position - surface.mean(0)) @ axis
    if abs(towards) < 0.3 * np.linalg.norm(camera.position - surface.mean(0)):
        raise InputError(
            f"scene.thickness_axis {scene.thickness_axis}: more than 72 degrees off the line of sight, so the camera does not see the face across it; "
            "give the axis that the camera looks along"
        )
    return axis * np.sign(towards)


def up_direction(scene: Scene, camera: Camera) -> np.ndarray:
    """World direction against gravity; against the image's downward axis where gravity is unknown or zero."""
    if scene.gravity_m_s2 is not None and np.linalg.norm(scene.gravity_m_s2) > 0:
        return -_unit(np.array(scene.gravity_m_s2, float))
    return -camera.world_from_camera[:3, 1]


def _faces(towards_camera: np.ndarray) -> list[tuple[int, int]]:
    return [(axis, side) for axis in range(3) if abs(towards_camera[axis]) < 0.7 for side in (1, -1)]


def _leaving(surface: np.ndarray, low: np.ndarray, high: np.ndarray, axis: int, side: int) -> float:
    """How many surface points lie in front of a face of the box, within the other two ranges."""
    lateral = [i for i in range(3) if i != axis]
    margin = 0.25 * (high - low).max()
    beside = ((surface[:, lateral] > low[lateral] - margin) & (surface[:, lateral] < high[lateral] + margin)).all(1)
    beyond = surface[:, axis] > high[axis] if side > 0 else surface[:, axis] < low[axis]
    return float((beside & beyond).sum())


def _require_object(clamp: Clamp, surface: np.ndarray, cure_gap: str, cure_free: str, least_free: float) -> None:
    extent = float(np.ptp(surface, axis=0).max())
    offset = np.abs(surface - clamp.centre) - clamp.half_size
    gap = float(np.linalg.norm(np.maximum(offset, 0), axis=1).min())
    if gap > LARGEST_GAP * extent:
        raise InputError(
            f"{clamp.told}: the nearest point of the object is {gap:.3g} m away, must be within {LARGEST_GAP * extent:.3g} m; {cure_gap}"
        )
    free = float(((surface - clamp.centre) @ clamp.normal > 0).mean())
    if free < least_free:
        raise InputError(
            f"{clamp.told}: only {100 * free:.0f} % of the visible object lies beyond its clamped plane, must be at least {100 * least_free:.0f} %; {cure_free}"
        )


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
