"""What modes that swing far do to each other: forces of second order in the amplitude. numpy only.

The strain E = (grad u + grad u' + grad u' grad u) / 2 of a large displacement (Green and Lagrange) makes the strain energy of a linear solid
W = W2 + W3 + ..., and W3, the integral of stress(u) : (grad u' grad u) / 2, gives each mode a force that is a product of the others: a body that
bends in two planes at once is twisted, the more so where the sum of both frequencies is near that of its torsion. To second order that
is exact: what the products bring about obeys the linear equation of motion (Nayfeh and Mook, Nonlinear Oscillations, 1979, chapter 6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..hooke import lame
from . import interpolation
from .model import ModalModel


@dataclass(frozen=True)
class SecondOrder:
    """Modal forces by products of the first l of r basis coordinates."""

    coupling: np.ndarray  # per part and Pa [1/(Pa s^2 m kg^1/2)], (n, r, l, l), alike in its last two

    @classmethod
    def of(cls, modal: ModalModel, leading: int) -> SecondOrder:
        """Of the `leading` first basis vectors of a model."""
        points, volume, _ = interpolation.quadrature(modal.nodes, modal.tets)
        slope = interpolation.at_quadrature(modal.nodes, modal.tets, modal.basis)[1]
        part = np.repeat(modal.part, len(points) // len(modal.part))
        each = (part == i + 1 for i in range(len(modal.poisson)))
        return cls(np.stack([_coupled(slope[own], volume[own], float(nu), leading) for own, nu in zip(each, modal.poisson, strict=True)]))

    def load(self, young: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
        """Modal loads (T, r) [N/kg^1/2] where the first l basis coordinates are (T, l), at Young's moduli (n,) [Pa]."""
        products = np.einsum("ti,tj->tij", coordinates, coordinates).reshape(len(coordinates), -1)
        coupling = np.tensordot(np.asarray(young, float), self.coupling, 1)
        return np.asarray(-products @ coupling.reshape(len(coupling), -1).T)


def _coupled(slope: np.ndarray, volume: np.ndarray, poisson: float, leading: int) -> np.ndarray:
    """Of points (Q,) that stand for volumes [m^3], with slopes (Q, 3, 3, r), slope[q, x, c] = d u_c / d x, of one material of 1 Pa: (r, l, l)."""
    strain = 0.5 * (slope + np.swapaxes(slope, 1, 2))
    lam, mu = lame(1.0, poisson)
    stress = volume[:, None, None, None] * (2 * mu * strain + lam * np.eye(3)[:, :, None] * np.trace(strain, axis1=1, axis2=2)[:, None, None])
    first, pulled = slope[..., :leading], stress[..., :leading]
    stretch = np.einsum("qxci,qycj->qxyij", first, first, optimize=True)
    turned = np.einsum("qxyi,qycj->qxcij", pulled, first, optimize=True)
    return np.asarray(0.5 * (_summed(stress, stretch) + _summed(slope, turned + np.swapaxes(turned, 3, 4))))


def _summed(each: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Products summed over points and both directions of (Q, 3, 3, r) and (Q, 3, 3, l, l): (r, l, l)."""
    count, leading = each.shape[3], pairs.shape[3]
    return np.asarray((each.reshape(-1, count).T @ pairs.reshape(-1, leading**2)).reshape(count, leading, leading))
