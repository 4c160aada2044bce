"""What a fit of the free frames may miss, as one covariance, so that two explanations are weighed as what they are worth.

Noise differs from frame to frame. Errors of the modes' shapes and of the stiffness along the body are the same in all frames: many frames do not
average them out, and a misfit that they can make is no sign of anything else. Generalised least squares (Aitken 1936). numpy only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TailErrors:
    """Of K frames of d coordinates each."""

    root: np.ndarray  # inverse square root of the covariance of a frame's noise, (d, d)
    along: np.ndarray  # orthonormal directions of what is the same in all frames, of whitened misfits, (K d, r)
    less: np.ndarray  # by how much misfits count less along them, 0..1, (r,)

    @classmethod
    def of(cls, noise: np.ndarray, alike: np.ndarray) -> TailErrors:
        """By a frame's noise, a covariance (d, d), and independent errors (K d, m), one standard deviation of each."""
        square, turn = np.linalg.eigh(noise)
        root = (turn / np.sqrt(square)) @ turn.T
        along, size, _ = np.linalg.svd(_in_every_frame(root, alike), full_matrices=False)
        return cls(root, along, 1.0 - 1.0 / np.sqrt(1.0 + size**2))

    def whitened(self, misfits: np.ndarray) -> np.ndarray:
        """Misfits (K d, m) in coordinates in which what may be missed is independent and of unit variance."""
        white = _in_every_frame(self.root, misfits)
        return np.asarray(white - self.along @ (self.less[:, None] * (self.along.T @ white)))


def _in_every_frame(turn: np.ndarray, misfits: np.ndarray) -> np.ndarray:
    """`turn` (d, d) applied to each frame of misfits (K d, m)."""
    frames = misfits.reshape(-1, len(turn), misfits.shape[1])
    return np.asarray((turn @ frames).reshape(misfits.shape))
