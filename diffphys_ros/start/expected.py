"""How large a force along the body, or in the plane of a sheet, is expected to be, which hardly moves it: as a share of the one at right angles to the body, frame by frame.

The stronger a push or a wind, the more of it may act that way, and it lasts no longer. What the motion tells of it counts as far as what is missed of motion
in its own shape lets it: a large swing is missed by much, and hardly ever in the shape that a body takes under a force along it. Where the motion tells
nothing the force along is none, the mean of what may act from either side.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .along import HELD, beside
from .force import ForceProblem, Solution
from .free_tail import Physics
from .place import QUARTER, leading_frames

ALIKE_FRAMES = 2.0  # standard deviation of the correlation of a force over frames [chosen]
NEAR_FRAMES = 1.0  # standard deviation of the weights of the frames that tell how large a force is in one [numerical]
LEAST = 1e-6  # of the largest variance: what is expected to be smaller is held at this [numerical]
UNSEEN = 1e-300  # how far a body is seen to stand off where a force that way moves nothing that is seen [numerical]


def expecting(problem: ForceProblem, physics: Physics, footprint: np.ndarray, *, missed: float = 0.0) -> ForceProblem:
    """`problem` with what the force that it finds under modal loads `footprint` (r, 3) lets expect in stiff ways. `missed`: square of what is missed of a
    frame at the least, over its sigma."""
    found = problem.solve(physics, footprint)
    frames = np.flatnonzero(problem.allowed)
    across = across_squared(found.force[frames], frames, problem.stiff.along)
    if not across.any():
        return problem
    variance, axes = np.linalg.eigh(together(across, frames) / problem.unit_of(footprint) ** 2)
    rows = axes.T / np.sqrt(np.maximum(variance, LEAST * variance[-1]))[:, None]
    once = max(QUARTER * leading_frames(problem, physics), 1.0) * missed_in_stiff_ways(problem, physics, found, footprint, missed=missed)
    return replace(problem, expected=np.sqrt(once)[:, None, None] * rows)


def missed_in_stiff_ways(problem: ForceProblem, physics: Physics, found: Solution, footprint: np.ndarray, *, missed: float = 0.0) -> np.ndarray:
    """Squares (h,) of what a solution misses of a frame, over its sigma, in the shape that a force in each of the stiff ways gives the body, while a force
    acts; at the least `missed` and the tracks' common error."""
    shapes, free = shapes_in_stiff_ways(problem, physics, footprint), without_force(problem, physics)
    left = (problem.missed(found)[free] @ shapes.T) ** 2
    return np.maximum(left.mean(0) * _growth(problem, shapes, free), max((problem.common_m / problem.sigma_m) ** 2, missed))


def _growth(problem: ForceProblem, shapes: np.ndarray, free: np.ndarray) -> np.ndarray:
    """How much larger the mean square (h,) of the motion's second order is in these shapes while a force acts than in the frames (K,) that are judged: what is
    missed of it grows with it, and looks like a force."""
    second = problem.seen.second_order
    if second is None:
        return np.ones(len(shapes))
    squares = (second[problem.known] @ shapes.T) ** 2
    judged = np.maximum(squares[free].mean(0), problem.common_m**2)
    return np.maximum(squares[problem.allowed[problem.known]].mean(0) / judged, 1.0)


def shapes_in_stiff_ways(problem: ForceProblem, physics: Physics, footprint: np.ndarray) -> np.ndarray:
    """Unit vectors (h, d) of how the body is seen to stand under a steady force in each of the stiff ways."""
    squares, shapes = problem.modal.eigen(physics.young, physics.density, physics.poisson)
    load = shapes.T @ footprint @ problem.stiff.ways.T
    stands = problem.seen.operator @ shapes @ (load / np.maximum(squares, HELD * squares[-1])[:, None])
    return np.asarray((stands / np.maximum(np.linalg.norm(stands, axis=0), UNSEEN)).T)


def without_force(problem: ForceProblem, physics: Physics) -> np.ndarray:
    """Which of the known frames (K,) come after the last force, where no force makes up for what is missed; all where they are no quarter of a period."""
    known = np.flatnonzero(problem.known)
    free = known > np.flatnonzero(problem.allowed).max(initial=-1)
    return free if free.sum() >= QUARTER * leading_frames(problem, physics) else np.ones_like(free)


def across_squared(force: np.ndarray, frames: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Squared size (F,) at right angles to unit vectors (h, 3) of forces (F, 3), each as large as those of the `frames` (F,) about it."""
    near = alike(frames, NEAR_FRAMES)
    return np.asarray(near @ ((force @ beside(along)) ** 2).sum(1) / near.sum(1))


def together(squared: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Covariance (F, F) of a force with these mean squares (F,) in frames (F,)."""
    size = np.sqrt(squared)
    return np.asarray(size[:, None] * alike(frames, ALIKE_FRAMES) * size)


def alike(frames: np.ndarray, width: float) -> np.ndarray:
    """Correlations (F, F) of frames (F,), Gaussian with a standard deviation of so many."""
    return np.asarray(np.exp(-0.5 * ((frames[:, None] - frames) / width) ** 2))
