"""How large a force along the body, or in the plane of a sheet, is expected to be, which hardly moves it: as a share of the one across, frame by frame.

The stronger a push or a wind, the more of it may act that way, and it lasts no longer. What the motion tells of it counts as far as what is missed of the
motion lets it; where that is nothing the force along is none, the mean of what may act from either side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .along import beside
from .force import ForceProblem
from .free_tail import Physics
from .place import counts_once

ALIKE_FRAMES = 2.0  # standard deviation of the correlation of a force over frames [chosen]
NEAR_FRAMES = 1.0  # standard deviation of the weights of the frames that tell how large a force is in one [numerical]
LEAST = 1e-6  # of the largest variance: what is expected to be smaller is held at this [numerical]


def expecting(problem: ForceProblem, physics: Physics, footprint: np.ndarray, *, missed: float = 0.0) -> ForceProblem:
    """`problem` with what the force that it finds under modal loads `footprint` (r, 3) lets expect in stiff ways. `missed`: square of what is missed of a
    frame at the least, over its sigma."""
    found = problem.solve(physics, footprint)
    frames = np.flatnonzero(problem.allowed)
    across = across_squared(found.force[frames], frames, problem.stiff.ways)
    if not across.any():
        return problem
    variance, axes = np.linalg.eigh(together(across, frames) / problem.unit_of(footprint) ** 2)
    once = counts_once(problem, physics, max(found.cost / problem.known.sum(), missed))
    return replace(problem, expected=np.sqrt(once / np.maximum(variance, LEAST * variance[-1]))[:, None] * axes.T)


def across_squared(force: np.ndarray, frames: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Squared size (F,) across stiff ways (h, 3) of forces (F, 3), each as large as those of the `frames` (F,) about it."""
    near = alike(frames, NEAR_FRAMES)
    return np.asarray(near @ ((force @ beside(ways)) ** 2).sum(1) / near.sum(1))


def together(squared: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Covariance (F, F) of a force with these mean squares (F,) in frames (F,)."""
    size = np.sqrt(squared)
    return np.asarray(size[:, None] * alike(frames, ALIKE_FRAMES) * size)


def alike(frames: np.ndarray, width: float) -> np.ndarray:
    """Correlations (F, F) of frames (F,), Gaussian with a standard deviation of so many."""
    return np.asarray(np.exp(-0.5 * ((frames[:, None] - frames) / width) ** 2))
