"""Which way is along the body: a force that way hardly moves it.

The frame's x is the normal of the face that was told or drawn as held, and a bar may leave that face askew.
"""

from __future__ import annotations

import numpy as np

from ..types import Body

LEAVES = 0.25  # of the body's reach from what holds it: so far it shows which way it leaves, and a branch mostly begins farther out [chosen]
AXIAL_SHARE = 0.05  # of a force along the body over one across it: what hardly moves the body would be made of tracking errors [chosen]
DEARER = 1 / AXIAL_SHARE  # how much more a force costs along the body than across it [derived]


def along_of(body: Body) -> np.ndarray:
    """Unit vector (3,), body frame, along the line through the middles of its sections next to what holds it; x of a body that nothing holds."""
    x, y = body.front.points[:, :2].T
    near = x <= x.min() + LEAVES * np.ptp(x)
    if not body.clamped or not np.ptp(x[near]) > 0:
        return np.array([1.0, 0.0, 0.0])
    volume = body.front.volume[near]
    x, y = (each[near] - volume @ each[near] / volume.sum() for each in (x, y))
    along = np.array([1.0, volume @ (x * y) / (volume @ x**2), 0.0])
    return np.asarray(along / np.linalg.norm(along))


def costs_of(along: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) whose product with a force has the size at which that force is priced: DEARER times its own along the body, its own across."""
    return np.eye(3) + (DEARER - 1) * np.outer(along, along)


def beside(along: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) that leaves of a force what acts across the body."""
    return np.eye(3) - np.outer(along, along)
