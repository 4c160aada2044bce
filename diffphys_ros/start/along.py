"""Which ways a force hardly moves the body: along it, and in the plane of a sheet.

The frame's x is the normal of the face that was told or drawn as held, and a bar may leave that face askew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..modes.model import ModalModel
from ..types import Body

LEAVES = 0.25  # of the body's reach from what holds it: so far it shows which way it leaves, and a branch mostly begins farther out [chosen]
HELD = 1e-9  # share of the largest squared frequency below which the lowest is that of a body that nothing holds [numerical]
AXIAL_SHARE = 0.05  # of a force along the body over one across it: what hardly moves the body would be made of tracking errors [chosen]
DEARER = 1 / AXIAL_SHARE  # how much more a force costs along the body than across it [derived]
ALONG = 0.25  # rms of a force along the body, which hardly moves it, over that at right angles [chosen]
IN_PLANE = 1.0  # the same of a force in the plane of a sheet, where it may come from any side [derived]


@dataclass(frozen=True)
class Stiff:
    """Ways in which a force hardly moves a body."""

    ways: np.ndarray  # unit vectors at right angles, body frame, along the body first, (h, 3)
    shares: np.ndarray  # rms of a force that way that is expected, over that at right angles to the body, (h,)
    prices: np.ndarray  # of a force that way over one across, before it is known how large that is, (h,)

    @classmethod
    def of(cls, along: np.ndarray, modal: ModalModel, *, has_depth: bool) -> Stiff:
        """Along (3,), and of the two ways across the one that a held body sags in under its own uniform load by less than AXIAL_SHARE of the other. A force
        that way is priced by what it moves: so small a motion is of a large force. Along alone where the tracks have no depth: what a sheet's plane shows
        may be all that is seen then."""
        only = cls(along[None], np.array([ALONG]), np.array([DEARER]))
        if not has_depth:
            return only
        squares, shapes = modal.eigen(modal.reference)
        if squares[0] < HELD * squares[-1]:
            return only
        across = both_across(along)
        sag = gives_way(squares, shapes.T @ modal.footprint_load(), across)
        ratio = sag.min() / sag.max()
        if ratio > AXIAL_SHARE:
            return only
        return cls(np.stack([along, across[sag.argmin()]]), np.array([ALONG, IN_PLANE]), np.array([DEARER, ratio]))

    @property
    def freed(self) -> Stiff:
        """The same where a force along the body costs as much as one across."""
        return replace(self, prices=np.r_[1.0, self.prices[1:]])

    @property
    def costs(self) -> np.ndarray:
        """Matrix (3, 3) whose product with a force has the size at which that force is priced."""
        return costs_of(self.ways, self.prices)

    @property
    def seen_ways(self) -> int:
        """How many ways are left, in which the body moves."""
        return 3 - len(self.ways)

    @property
    def along(self) -> np.ndarray:
        """Unit vector along the body, (1, 3)."""
        return self.ways[:1]

    @property
    def expected(self) -> np.ndarray:
        """Mean squares of a force these ways over that at right angles to the body, between components, (3, 3)."""
        return self.ways.T @ (self.shares[:, None] ** 2 * self.ways)


def both_across(along: np.ndarray) -> np.ndarray:
    """Unit vectors (2, 3) at right angles to one along the body, (3,), which has no z."""
    return np.array([[-along[1], along[0], 0.0], [0.0, 0.0, 1.0]])


def gives_way(squares: np.ndarray, load: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """How far a held body with squared frequencies (r,) [1/s^2] gives way to steady loads (r, 3) on its eigenmodes that act these ways (k, 3), where they act: (k,)."""
    return np.asarray(((load @ ways.T) ** 2 / squares[:, None]).sum(0))


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


def costs_of(ways: np.ndarray, prices: np.ndarray | float = DEARER) -> np.ndarray:
    """Matrix (3, 3) whose product with a force has the size at which that force is priced: `prices` (h,) times its own in stiff ways (h, 3), its own across."""
    return np.eye(3) + (ways.T * (np.asarray(prices) - 1)) @ ways


def beside(ways: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) that leaves of a force what acts across stiff ways (h, 3)."""
    return np.eye(3) - ways.T @ ways
