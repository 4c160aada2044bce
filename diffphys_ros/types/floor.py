"""A floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Floor:
    """Material stays where up . x >= height_m, body frame."""

    up: np.ndarray  # unit vector out of it, (3,)
    height_m: float
