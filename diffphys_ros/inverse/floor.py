"""The floor that a person told of, as the simulator's border."""

from __future__ import annotations

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..simulate import Plane
from ..types import Body, Particles


def floor_planes(body: Body, particles: Particles, scene: Scene, *, dx: float) -> tuple[Plane, ...]:
    """scene.floor_z_m in the body frame, none where it is not given. Raises InputError where the object reaches a grid cell below it."""
    if scene.floor_z_m is None:
        return ()
    up = body.world_from_body[2, :3]  # the world's z axis in body components
    offset = scene.floor_z_m - float(body.world_from_body[2, 3])
    lowest = float((particles.x_rest[~particles.ghost] @ up).min()) - offset
    if lowest < -dx:
        raise InputError(f"scene.floor_z_m {scene.floor_z_m:g} m: the object reaches {-lowest:.3g} m below it in frame 0; lower the floor")
    return (Plane(np.asarray(up), offset, "separate", scene.floor_friction),)
