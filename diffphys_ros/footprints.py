"""Spatial families of the force field: density [N/m^3 of rest volume] = amplitude(t) * weight(rest position)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .errors import InputError

Family = Callable[[np.ndarray, np.ndarray], np.ndarray]


def uniform(points: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Weight 1 everywhere, (P,): wind across a small body, an inertial force."""
    return np.ones(len(points))


def gaussian(points: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """A local push: Gaussian of the in-plane distance from (x, y) [m, body] with width sigma [m]; footprint (3,)."""
    distance2 = ((points[:, :2] - footprint[:2]) ** 2).sum(1)
    return np.exp(-0.5 * distance2 / footprint[2] ** 2)


FAMILIES: dict[str, Family] = {"uniform": uniform, "gaussian": gaussian}


def footprint_weights(family: str, points: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Weights (P,) of a named family at rest positions (P, 3) [m, body frame]."""
    if family not in FAMILIES:
        raise InputError(f"force family {family!r} is unknown; the known ones are {', '.join(FAMILIES)}")
    return FAMILIES[family](points, footprint)
