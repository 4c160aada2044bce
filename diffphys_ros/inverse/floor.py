"""The floor that a person told of, as the simulator's border."""

from __future__ import annotations

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..picture import on_plane
from ..simulate import Plane
from ..types import Body, Camera, Particles


def floor_planes(body: Body, particles: Particles, scene: Scene, camera: Camera, *, dx: float) -> tuple[Plane, ...]:
    """scene.floor_z_m or floor_px in the body frame, none where neither is given. Raises InputError where the object reaches a grid cell below it."""
    if scene.floor_px is not None:
        return (_under_line(body, particles, scene, camera, dx),)
    if scene.floor_z_m is None:
        return ()
    up = body.world_from_body[2, :3]  # the world's z axis in body components
    offset = scene.floor_z_m - float(body.world_from_body[2, 3])
    lowest = float((particles.x_rest[~particles.ghost] @ up).min()) - offset
    if lowest < -dx:
        raise InputError(f"scene.floor_z_m {scene.floor_z_m:g} m: the object reaches {-lowest:.3g} m below it in frame 0; lower the floor")
    return (Plane(np.asarray(up), offset, "separate", scene.floor_friction),)


def _under_line(body: Body, particles: Particles, scene: Scene, camera: Camera, dx: float) -> Plane:
    """The plane along the body's thickness through a line of the picture at its mid-plane; the object is above it."""
    assert scene.floor_px is not None
    ends = body.to_body(on_plane(camera, scene.floor_px, body.world_from_body[:3, 3], body.world_from_body[:3, 2]))
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    up = np.array([-along[1], along[0], 0.0])
    x = particles.x_rest[~particles.ghost]
    up *= np.sign(np.median((x - ends[0]) @ up)) or 1.0
    lowest = float(((x - ends[0]) @ up).min())
    if lowest < -dx:
        raise InputError(f"scene.floor_px {scene.floor_px}: the object reaches {-lowest:.3g} m below it in frame 0; draw the line lower")
    return Plane(up, float(ends[0] @ up), "separate", scene.floor_friction)
