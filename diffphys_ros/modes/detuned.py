"""Modes of a body that is not quite the model's: each frequency a little off, and neighbours coupled.

An error of stiffness that nobody sees is a small symmetric matrix on the leading modes. Its diagonal moves their frequencies. What lies beside it
turns two modes into each other, by its size over the gap between their frequencies: hardly at all as a rule, and by any angle where the two are
nearly one, as those of a round cable or a square beam that bends both ways (Courant and Hilbert 1924, perturbation of degenerate eigenvalues). Only these
are coupled here: by how little others turn is an error of their shapes like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAR = 0.01  # between the logs of two frequencies: a standard deviation, as it were, of how far apart two modes lie that are coupled; twice as far, an error of .6 % turns them by less than a fifth [chosen]
EQUAL = 1e-12  # squared frequencies that differ by less of the largest are equal [numerical]


@dataclass(frozen=True)
class Detuned:
    """k leading modes; their matrix is omega (exp(2 detune) + 2 closeness coupling) omega on the model's own."""

    omega: np.ndarray  # angular frequencies of the model [rad/s], (k,)
    detune: np.ndarray  # log of the body's frequencies over these, (k,)
    close: np.ndarray  # how much of a coupling to the next one counts, 0..1, (k - 1,)
    inner: np.ndarray  # the matrix between the two omega, (k, k)
    squares: np.ndarray  # squared angular frequencies of the body [1/s^2], (k,)
    turn: np.ndarray  # its modes as columns of those of the model, (k, k)

    @classmethod
    def of(cls, squares: np.ndarray, detune: np.ndarray, coupling: np.ndarray | None = None) -> Detuned:
        """Of the model's squared angular frequencies (r,), of which the leading len(detune) are off, and coupled each to the next as far as `coupling` goes."""
        coupling = np.zeros(0) if coupling is None else coupling
        omega, detune = np.sqrt(np.maximum(squares[: len(detune)], 0.0)), detune[: len(squares)]
        inner, close, beside = np.diag(np.exp(2 * detune)), _closeness(omega), np.arange(min(len(coupling), max(len(omega) - 1, 0)))
        inner[beside, beside + 1] = inner[beside + 1, beside] = 2 * close[beside] * coupling[beside]
        if not coupling.any():
            return cls(omega, detune, close, inner, omega**2 * np.diagonal(inner), np.eye(len(omega)))
        return cls(omega, detune, close, inner, *np.linalg.eigh(omega[:, None] * inner * omega))

    @property
    def change(self) -> np.ndarray:
        """What the matrix has more than the model's, (k, k) [1/s^2]."""
        return self.omega[:, None] * (self.inner - np.eye(len(self.omega))) * self.omega

    def leading(self, squares: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The body's for the model's, among all squared frequencies (r,) and shapes (d, r)."""
        count = len(self.omega)
        return np.r_[self.squares, squares[count:]], np.hstack([shapes[:, :count] @ self.turn, shapes[:, count:]])

    def by_detune(self) -> np.ndarray:
        """Derivatives (k, k, k) of the matrix by `detune`."""
        own = 2 * np.exp(2 * self.detune) * self.omega**2
        return own[:, None, None] * np.eye(len(own))[:, :, None] * np.eye(len(own))[:, None, :]

    def by_coupling(self, count: int) -> np.ndarray:
        """The same by the couplings, (count, k, k): zeros for those of modes that are not there."""
        found, beside = np.zeros((count, len(self.omega), len(self.omega))), np.arange(min(count, len(self.close)))
        found[beside, beside, beside + 1] = found[beside, beside + 1, beside] = 2 * (self.close * self.omega[:-1] * self.omega[1:])[beside]
        return found

    def by_squares(self, change: np.ndarray) -> np.ndarray:
        """Changes (S, k, k) of the matrix where those of the model's squared frequencies are (S, k)."""
        by_log = 0.5 * change / np.where(self.omega > 0, self.omega, np.inf) ** 2
        found = self.omega[:, None] * self.inner * self.omega * (by_log[:, :, None] + by_log[:, None, :])
        beside = np.arange(len(self.close))
        apart = _apart(self.omega) / NEAR**2 * np.diff(by_log, axis=1)
        found[:, beside, beside + 1] -= self._coupled * apart
        found[:, beside + 1, beside] -= self._coupled * apart
        return found

    @property
    def _coupled(self) -> np.ndarray:
        """What the matrix has beside its diagonal, (k - 1,)."""
        return np.diagonal(self.inner, 1) * self.omega[:-1] * self.omega[1:]

    def slopes(self, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Changes (S, k) of the squared frequencies with those of the matrix, (S, k, k), and how the body's modes mix with them, (S, k, k)."""
        inside = self.turn.T @ change @ self.turn
        return np.diagonal(inside, axis1=1, axis2=2), mixed(inside, self.squares)


def mixed(change: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """How much each mode takes on of the others, (S, k, k) with a column for each, where the matrix whose diagonal their `squares` (k,) are changes by
    (S, k, k) on them. What modes of equal frequency turn among themselves changes no motion and is left out."""
    apart = squares - squares[:, None]
    equal = np.abs(apart) <= EQUAL * np.abs(squares).max(initial=0.0)
    return np.where(equal, 0.0, change / np.where(equal, 1.0, apart))


def _apart(omega: np.ndarray) -> np.ndarray:
    """Logarithms of frequencies (k,) over the one before, (k - 1,); of those that do not swing, far more than NEAR."""
    log = np.log(np.maximum(omega, np.finfo(float).tiny))
    return np.where(omega[:-1] > 0, np.diff(log), 1.0)


def _closeness(omega: np.ndarray) -> np.ndarray:
    """1 where two neighbours have one frequency, 0 far apart, (k - 1,)."""
    return np.asarray(np.exp(-0.5 * (_apart(omega) / NEAR) ** 2))
