"""What a motion of large amplitude is beyond its linear one.

Products of the leading coordinates move the points (foreshortening and the like) by factors that nobody knows beforehand. Found first and taken off the
tracks, such products take what a force does along with them: under a steady wind a bend of second shape and the square of the bend of the first look
alike. So they are left open beside the force: what any of them can explain counts neither for nor against it. Products also drive modes
(modes/second_order.py), and by how much is computed: a body that bends in two planes twists, which passes for a push beside its axis otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ..linear_systems import solved
from ..modes.model import ModalModel
from ..modes.response import driven
from ..modes.second_order import SecondOrder
from ..nuisance import Nuisance
from ..vibration.coordinates import Motion, Projection

SOFT = 20.0  # times the lowest squared frequency: softer modes swing far, and their products drive others; a bar three times as long as thick stretches at 21 [derived]
QUICK = 40.0  # times the same: stiffer modes follow a product of the softest as if at rest, to a tenth; that is left open already, and how they ring tells nothing of a large swing [derived]
PRODUCT_SD = 2.0  # of the factors of products of coordinates, times the body's length: the tip of a bent bar moves twice as far as its points on the mean, and back by .6 of the square of that over the length [derived]
SUBSTEPS = 4  # of a frame, between which a product is taken as constant [numerical]


@dataclass(frozen=True)
class LargeSwing:
    """Of T frames, of which K are known, of a clip that begins at rest."""

    second: SecondOrder
    coordinates: np.ndarray  # of the leading basis vectors, between frames, ((T - 1) SUBSTEPS, l)
    products: Nuisance  # of the observed coordinates, in the known frames
    period_s: float

    @classmethod
    def of(cls, motion: Motion, seen: Projection, modal: ModalModel, sigma_m: float, period_s: float) -> LargeSwing:
        """Of what is observed, a coordinate of which is known to `sigma_m`."""
        coordinates = leading(seen, modal, sigma_m)
        return cls(SecondOrder.of(modal, coordinates.shape[1]), between(coordinates), Nuisance.of(products(motion, modal)[motion.known] / sigma_m), period_s)

    def driven(self, young: np.ndarray, omega2: np.ndarray, decay: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Coordinates (T, r) of eigenmodes `shapes` (r, r) with squared frequencies [1/s^2] and decay [1/s] (r,), as products drive them."""
        load = self.second.load(young, self.coordinates) @ shapes
        return driven(omega2, decay, self.period_s, np.where(omega2 <= QUICK * omega2[0], load, 0.0), SUBSTEPS)


def leading(seen: Projection, modal: ModalModel, sigma_m: float) -> np.ndarray:
    """Coordinates of the soft ones of the first basis vectors, (T, l), that explain what is seen: each expected to be as large as the softest would move
    the points under the force on it. What is seen of a stiff one is itself of second order: how a bent bar shortens, taken for a stretch, would stiffen it."""
    squares = np.maximum(np.diag(modal.matrix(modal.reference)), 1.0)
    count = int((squares <= SOFT * squares[0]).cumprod().sum())
    squares = squares[:count]
    operator, moved = seen.operator[:, :count], seen.data
    size = float(np.sqrt((moved**2).sum(1).max())) / max(float(np.linalg.norm(operator[:, 0])), 1e-12)
    expected = np.maximum(size * squares[0] / squares, 1e-12)
    return np.asarray(solved(operator.T @ operator + np.diag((sigma_m / expected) ** 2), operator.T @ moved.T).T)


def between(coordinates: np.ndarray) -> np.ndarray:
    """Coordinates of frames (T, l) in the middle of SUBSTEPS steps from each to its next, ((T - 1) SUBSTEPS, l)."""
    frames = np.arange(len(coordinates))
    return np.asarray(CubicSpline(frames, coordinates)((np.arange((len(frames) - 1) * SUBSTEPS) + 0.5) / SUBSTEPS))


def products(motion: Motion, modal: ModalModel) -> np.ndarray:
    """How far products of the observed coordinates may move the points, root mean square [m], (T, m)."""
    return PRODUCT_SD / float(np.ptp(modal.nodes, axis=0).max()) * motion.products
