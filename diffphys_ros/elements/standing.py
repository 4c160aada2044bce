"""A body that stands on a floor: how it shrinks and stretches along the vertical there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from .assemble import Elements

FOOT_SHARE = 0.015  # of the height, within which of the lowest point what meets the floor lies [chosen]
STIFFER = 1e4  # springs of the floor at the foot, over the largest stiffness of a node: a frequency is .1 % low [numerical]
STRAINS = 1e-6  # of the largest strain energy of a mode, below which one is a motion of the whole [numerical]
COUNT = 12  # modes among which the one along the vertical is looked for: four in ten of them bend and twist [numerical]


@dataclass(frozen=True)
class Standing:
    """Modes of a body whose foot the floor holds, at a modulus of its own."""

    stuck_hz: float  # of the one along the vertical, where the foot sticks to the floor [Hz]
    sliding_hz: float  # where it slides [Hz]
    shape: np.ndarray  # of that mode, where the foot sticks, at the nodes (N, 3)
    others: np.ndarray  # of those that are slower, (N, 3, k)


def standing(elements: Elements, young: np.ndarray, up: np.ndarray) -> Standing:
    """Of a body that nothing else holds, at moduli (n,) [Pa]; `up` (3,): unit vector out of the floor, body frame. Without gravity's prestress."""
    foot, stiffness = foot_of(elements.nodes, up), elements.elastic(young)
    stuck, sliding = (_modes(elements, stiffness, foot, held) for held in (np.eye(3), np.outer(up, up)))
    best, other = (int(np.argmax(_along(elements, stiffness, shapes, up))) for _, shapes in (stuck, sliding))
    shapes = stuck[1].reshape(len(elements.nodes), 3, -1)
    return Standing(stuck[0][best], sliding[0][other], shapes[..., best], shapes[..., :best])


def foot_of(nodes: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Which nodes (N, 3) [m] meet a floor that a body stands on, bool (N,)."""
    height = nodes @ up
    return np.asarray(height < height.min() + FOOT_SHARE * np.ptp(height))


def _modes(elements: Elements, stiffness: sp.csc_matrix, foot: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (k,) [Hz] and mass-orthonormal shapes (D, k), with springs at the foot along what `held` (3, 3) projects on."""
    springs = sp.kron(sp.diags(foot.astype(float)), STIFFER * stiffness.diagonal().max() * held).tocsc()
    matrix = (stiffness + springs).tocsc()
    squares, shapes = elements.eigenmodes(matrix, elements.factor(matrix), COUNT)
    return np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi), shapes


def _along(elements: Elements, stiffness: sp.csc_matrix, shapes: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Share of the mass that modes (D, k) move along `up`, (k,); of what does not strain, none."""
    rigid = np.tile(up, len(elements.nodes))
    moved = elements.mass @ rigid
    share = (shapes.T @ moved) ** 2 / (rigid @ moved)
    strain = (shapes * (stiffness @ shapes)).sum(0)
    return np.where(strain > STRAINS * strain.max(), share, 0.0)
