"""What a fit of the free frames may miss, as one covariance, so that two explanations are weighed as what they are worth.

Noise differs from frame to frame. Errors of the modes' shapes, and of the stiffness along the body, are the same in all frames: many frames do not
average them out, and a misfit that they can make is no sign of anything else. Generalised least squares (Aitken 1936).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .free_tail import Physics, Tail
from .uncertainty import LEADING, UNSEEN_SD


@dataclass(frozen=True)
class TailErrors:
    """Of K frames of d coordinates each, in which k modes swing."""

    turn: np.ndarray  # of a frame, onto coordinates in which noise has unit variance and errors of shapes are independent, (d, d)
    when: np.ndarray  # orthonormal functions of time in which the modes swing, (K, k)
    held: np.ndarray  # by how much misfits of such a function and coordinate count less, 0..1, (k, d)
    along: np.ndarray  # orthonormal directions of other errors that are the same in all frames, (K d, m)
    less: np.ndarray  # by how much misfits count less along them, 0..1, (m,)

    @classmethod
    def of(cls, noise: np.ndarray, swings: np.ndarray, shapes: np.ndarray, others: np.ndarray) -> TailErrors:
        """By a frame's noise, a covariance (d, d); the modes' motion over time (K, k), and the covariance (d, d) by which each one's shape is off, as a share
        of that; and other, independent errors (K d, m), one standard deviation of each."""
        square, axes = np.linalg.eigh(noise)
        root = (axes / np.sqrt(square)) @ axes.T
        off, own = np.linalg.eigh(root @ shapes @ root)
        when, size, _ = np.linalg.svd(swings, full_matrices=False)
        held = _less(np.outer(size**2, np.maximum(off, 0.0)))
        without = cls(own.T @ root, when, held, np.zeros((len(swings) * len(noise), 0)), np.zeros(0))
        along, size, _ = np.linalg.svd(without.whitened(others), full_matrices=False)
        return cls(without.turn, when, held, along, _less(size**2))

    @classmethod
    def if_right(cls, tail: Tail, physics: Physics, others: np.ndarray) -> TailErrors:
        """Of a tail if its physics is right: noise as it leaves; shapes as of a fit that misses nothing along the leading ones, which stiffness would take on,
        and as it misses beside them; and others (K d, m), in standard deviations."""
        leading = tail.smooth(physics, LEADING)
        smooth, bent = leading @ leading.T, tail.bent()
        shapes = smooth * (UNSEEN_SD**2 / leading.shape[1])
        for rest in (bent - smooth, np.eye(len(bent)) - bent):
            shapes = shapes + rest * (tail.rough(physics, rest) / max(np.trace(rest), 1.0))
        return cls.of(tail.noise(physics), tail.swings(physics) / tail.sigma_m, shapes, others)

    def whitened(self, misfits: np.ndarray) -> np.ndarray:
        """Misfits (K d, m) in coordinates in which what may be missed is independent and of unit variance."""
        frames = self.turn @ misfits.reshape(len(self.when), len(self.turn), misfits.shape[1])
        in_step = np.tensordot(self.when.T, frames, 1) * self.held[:, :, None]
        white = (frames - np.tensordot(self.when, in_step, 1)).reshape(misfits.shape)
        return np.asarray(white - self.along @ (self.less[:, None] * (self.along.T @ white)))


def _less(square: np.ndarray) -> np.ndarray:
    """By how much a misfit counts less that may be off by a variance beside its unit one."""
    return np.asarray(1.0 - 1.0 / np.sqrt(1.0 + square))
