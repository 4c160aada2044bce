"""The floor that a person told of: where it lies in the body's frame, and as the simulator's border."""

from __future__ import annotations

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..picture import on_plane
from ..simulate import Plane
from ..types import Body, Camera, Floor, Particles


def floor_planes(body: Body, particles: Particles, scene: Scene, camera: Camera, *, dx: float) -> tuple[Plane, ...]:
    """scene.floor_z_m or floor_px in the body frame, none where neither is given. Raises InputError where the object reaches a grid cell below it."""
    points = particles.x_rest[~particles.ghost]
    floor = floor_of(body, scene, camera)
    if floor is None:
        return ()
    lowest = float((points @ floor.up).min()) - floor.height_m
    if lowest < -dx:
        told, cure = ("floor_px", "draw the line lower") if scene.floor_px is not None else ("floor_z_m", "lower the floor")
        value = scene.floor_px if scene.floor_px is not None else f"{scene.floor_z_m:g} m"
        raise InputError(f"scene.{told} {value}: the object reaches {-lowest:.3g} m below it in frame 0; {cure}")
    return (Plane(floor.up, floor.height_m, "separate", scene.floor_friction),)


def floor_of(body: Body, scene: Scene, camera: Camera) -> Floor | None:
    """The floor that is told, body frame; None where none is."""
    if scene.floor_px is not None:
        return _under_line(body, scene.floor_px, camera)
    if scene.floor_z_m is None:
        return None
    return Floor(body.world_from_body[2, :3].copy(), scene.floor_z_m - float(body.world_from_body[2, 3]))  # up: the world's z axis in body components


def _under_line(body: Body, line: list[float], camera: Camera) -> Floor:
    """The plane along the body's thickness through a line of the picture at its mid-plane; the object is above it."""
    ends = body.to_body(on_plane(camera, np.reshape(line, (2, 2)), body.world_from_body[:3, 3], body.world_from_body[:3, 2]))
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    up = np.array([-along[1], along[0], 0.0])
    up *= np.sign(np.median((body.front.points - ends[0]) @ up)) or 1.0
    return Floor(up, float(ends[0] @ up))
