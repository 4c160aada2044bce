"""The force that a motion tells: its share in each mode.

A force near the clamp, or one that no visible mode feels, moves nothing, so no film tells the net force alone. What acts on a
mode does move it: q(t) = sum over vertices of f(t) . phi [N / sqrt(kg)], phi the mode's mass-normalised shape (Ewins, Modal Testing).
"""

from __future__ import annotations

import numpy as np

from .truth import Arrays, free_volume

MOST_MODES = 2
LEAST_SHARE = 0.02  # of the motion's energy, below which a mode is not scored
LEAST_TAIL = 10  # frames without force, from which on the shapes are taken from them alone
EXPLAINED = 0.95  # of the acceleration that two uncoupled oscillators must explain before modes are told apart by it
STILL_M = 1e-7  # rms motion below which there is none


def score_modal(truth: Arrays, force: np.ndarray) -> dict[str, object]:
    """modal_force_relative_rmse, a list with an entry a mode, for a density (T, V, 3) [N/m^3] at the truth's vertices.

    Empty where the truth has no masses or does not move; an entry is None where no true force acts on the mode.
    """
    if "vertex_mass" not in truth:
        return {}
    shapes = modes_of(truth)
    volume, true = free_volume(truth), truth["force_density"][: len(force)].astype(float)
    errors: list[float | None] = []
    for shape in shapes:
        wanted, found = (np.einsum("tvc,vc,v->t", density, shape, volume) for density in (true, force))
        size = float(np.sqrt((wanted**2).sum()))
        errors.append(float(np.sqrt(((found - wanted) ** 2).sum())) / size if size > 1e-9 * _size(true, volume) else None)
    return {"modal_force_relative_rmse": errors}


def modes_of(truth: Arrays) -> list[np.ndarray]:
    """Leading mass-normalised shapes (V, 3) [1/sqrt(kg)] of the true motion, the strongest first.

    Proper orthogonal modes of the free tail, or of the whole clip where there is hardly one. A few swings do not tell two such
    modes apart: in a free tail they are turned so that each swings by itself.
    """
    weight = np.sqrt(np.maximum(truth["vertex_mass"], np.finfo(float).tiny))[:, None]
    path = truth["positions"].astype(float)
    moving, free = _tail(path, truth["force_density"])
    states = (weight * (moving - moving.mean(0))).reshape(len(moving), -1)
    energy = (states**2).sum()
    if energy < len(states) * STILL_M**2 * (weight**2).sum():
        return []
    left, size, shapes = np.linalg.svd(states, full_matrices=False)
    count = min(MOST_MODES, max(1, int((size**2 > LEAST_SHARE * energy).sum())))
    over_time, shapes = left[:, :count] * size[:count], shapes[:count]
    if free and count > 1:
        shapes = _apart(over_time).T @ shapes
    return [shape.reshape(-1, 3) / weight for shape in shapes]


def _tail(path: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, bool]:
    """Positions of the frames after the force, and True; all positions where they are few or still."""
    energy = (force.astype(float) ** 2).sum((1, 2))
    forced = np.flatnonzero(energy > 1e-12 * energy.max())
    tail = path[int(forced[-1]) + 1 if len(forced) else 0 :]
    moves = len(tail) >= LEAST_TAIL and tail.var(0).sum() > 1e-4 * path.var(0).sum()
    return (tail, True) if moves else (path, False)


def _apart(over_time: np.ndarray) -> np.ndarray:
    """Rotation (n, n) of coordinates (T, n) into those that swing independently: h'' = -K h - C h' + c along the axes of K."""
    second = over_time[2:] - 2 * over_time[1:-1] + over_time[:-2]
    terms = np.hstack([over_time[1:-1], over_time[2:] - over_time[:-2], np.ones((len(second), 1))])
    found = np.linalg.lstsq(terms, second, rcond=None)[0]
    count = over_time.shape[1]
    if ((second - terms @ found) ** 2).sum() > (1 - EXPLAINED) * ((second - second.mean(0)) ** 2).sum():
        return np.eye(count)
    _, axes = np.linalg.eigh(found[:count] + found[:count].T)
    return axes[:, np.argsort(-((over_time @ axes) ** 2).sum(0))]


def _size(density: np.ndarray, volume: np.ndarray) -> float:
    return float(np.sqrt((np.einsum("tvc,v->tc", density, volume) ** 2).sum()))
