"""What a body meets: half-spaces that it cannot enter, and a handle that moves a part of it rigidly.

Both are conditions on the velocities of grid nodes, stated in the body frame; `contact.py` holds their Warp functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

KINDS = ("sticky", "slip", "separate")
EDGE = 1e-3  # nodes this share of a cell outside still belong to a plane or box: rounding does not decide about aligned ones


@dataclass(frozen=True)
class Plane:
    """A floor or wall: material stays where normal . x >= offset_m. It acts on the nodes at and below the plane.

    "sticky": these nodes stand still; "slip": they move along the plane only; both act on all that comes within the reach
    of such a node, up to 1.5 cells above the plane. "separate": nodes may move away from it, and what is near may come as
    near as the plane itself (see approach.py). `friction` is Coulomb's coefficient: a node that presses against the plane
    loses up to friction times the normal velocity it loses ("slip" and "separate").
    """

    normal: Sequence[float] | np.ndarray  # out of the obstacle; any length but zero, shape (3,)
    offset_m: float
    kind: str = "separate"
    friction: float = 0.0

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(np.asarray(self.normal, float)))
        if np.shape(self.normal) != (3,) or not np.isfinite(length) or length == 0:
            raise InputError(
                f"plane: the normal {self.normal} must be three finite numbers that are not all zero; give the direction out of the floor"
            )
        if self.kind not in KINDS:
            raise InputError(f"plane: kind {self.kind!r} is unknown; choose one of " + ", ".join(KINDS))
        if not (np.isfinite(self.friction) and self.friction >= 0 and np.isfinite(self.offset_m)):
            raise InputError(
                f"plane: friction {self.friction} and offset {self.offset_m} m must be finite and friction not negative; correct them"
            )

    @property
    def unit_normal(self) -> np.ndarray:
        """Normal of length one, shape (3,)."""
        normal = np.asarray(self.normal, float)
        return normal / np.linalg.norm(normal)

    @property
    def kind_index(self) -> int:
        """Number of the kind in the kernels."""
        return KINDS.index(self.kind)


@dataclass(frozen=True)
class Handle:
    """A box that holds the material in it, as a gripper does: its nodes have the velocity of the box's rigid motion.

    The box is axis-aligned in the frame of the handle; infinite bounds are allowed (a half-space is a clamp). Where no
    motion is given it stands still at `body_from_handle`: a clamp in any orientation. The motion may be learnt: see
    `handle.substep_poses`.
    """

    low: Sequence[float] | np.ndarray  # lower corner in the handle's frame [m], shape (3,)
    high: Sequence[float] | np.ndarray  # upper corner [m], shape (3,)
    body_from_handle: np.ndarray | None = None  # pose where it takes hold, rigid, m, shape (4, 4); None: the body frame itself

    def __post_init__(self) -> None:
        if np.shape(self.low) != (3,) or np.shape(self.high) != (3,) or not np.all(np.less(self.low, self.high)):
            raise InputError(f"handle: the box from {self.low} to {self.high} m is empty; low must be below high along all three axes")
        if self.body_from_handle is not None and np.shape(self.body_from_handle) != (4, 4):
            raise InputError(
                f"handle: body_from_handle has shape {np.shape(self.body_from_handle)}; give a rigid transform of shape (4, 4)"
            )

    @property
    def pose(self) -> np.ndarray:
        """Transform from the handle's to the body frame where it takes hold, shape (4, 4)."""
        return np.eye(4) if self.body_from_handle is None else np.asarray(self.body_from_handle, float)

    def holds(self, nodes: np.ndarray, *, dx: float) -> np.ndarray:
        """Which of the nodes at (..., 3) [m] of a grid of spacing `dx` [m] it holds where it takes hold."""
        local = (nodes - self.pose[:3, 3]) @ self.pose[:3, :3]
        return np.all((local >= np.asarray(self.low) - EDGE * dx) & (local <= np.asarray(self.high) + EDGE * dx), -1)


@dataclass(frozen=True)
class Borders:
    """All that a simulation's grid nodes meet."""

    planes: tuple[Plane, ...] = ()
    handle: Handle | None = None

    def __bool__(self) -> bool:
        return bool(self.planes) or self.handle is not None

    @property
    def box(self) -> tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]:
        """Corners of the handle's box in its frame [m]; nothing lies inside where there is no handle."""
        return (self.handle.low, self.handle.high) if self.handle else ((np.inf,) * 3, (-np.inf,) * 3)
