"""Motion of damped oscillators under a force that is constant within a frame: exact integration. numpy and scipy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft  # scipy.signal has this convolution, and takes half a second to import

SLOWEST = 1e-3  # [rad/s]; rigid motion is integrated as an oscillation this slow [numerical]


@dataclass(frozen=True)
class Step:
    """Exact transition of r oscillators over one frame: state (displacement, rate) <- matrix @ state + load * push."""

    matrix: np.ndarray  # (2, 2, r)
    push: np.ndarray  # (2, r)

    @classmethod
    def of(cls, omega2: np.ndarray, decay: np.ndarray, period_s: float) -> Step:
        """For q'' + 2 g q' + w^2 q = p with w^2 = omega2 [1/s^2] (r,), g = decay [1/s] (r,), p constant over period_s."""
        omega2 = np.maximum(omega2, SLOWEST**2)
        split = np.sqrt(decay.astype(complex) ** 2 - omega2)
        split = np.where(np.abs(split) * period_s < 1e-7, 1e-7 / period_s, split)
        fast, slow = np.exp((-decay - split) * period_s), np.exp((-decay + split) * period_s)
        even, odd = ((slow + fast) / 2).real, ((slow - fast) / (2 * split)).real
        matrix = np.array([[even + decay * odd, odd], [-omega2 * odd, even - decay * odd]])
        return cls(matrix, np.array([(1 - matrix[0, 0]) / omega2, odd]))

    def __call__(self, state: np.ndarray, load: np.ndarray | float = 0.0) -> np.ndarray:
        """State (2, r, ...) one frame later under modal loads (r, ...)."""
        extra = (1,) * (state.ndim - 2)
        matrix, push = self.matrix.reshape(2, 2, -1, *extra), self.push.reshape(2, -1, *extra)
        return np.einsum("ab...,b...->a...", matrix, state) + push * load

    def history(self, state: np.ndarray, frames: int) -> np.ndarray:
        """Free displacements (frames, r) from a state (2, r) at frame 0."""
        states, ahead = state[:, None], self.matrix  # of the first frames, and what takes a state as many frames further
        while states.shape[1] < frames:
            states = np.concatenate([states, ahead[:, 0, None] * states[0] + ahead[:, 1, None] * states[1]], 1)
            ahead = ahead[:, 0, None] * ahead[0] + ahead[:, 1, None] * ahead[1]
        return states[0, :frames]

    def pulse(self, frames: int) -> np.ndarray:
        """Displacements (frames, r) after a unit load that acted in frame 0 alone."""
        rest = np.zeros_like(self.push)
        after = self(rest, 1.0)
        return np.vstack([rest[:1], self.history(after, frames - 1)])

    def released(self, frames: int) -> np.ndarray:
        """Displacements (frames, 2, r) from unit displacement and from unit rate at frame 0."""
        one, none = np.ones(self.push.shape[1]), np.zeros(self.push.shape[1])
        return np.stack([self.history(np.array(s), frames) for s in ((one, none), (none, one))], 1)


def convolve(pulse: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Displacements (T, r) from rest under loads (T, r), by the pulse response (T, r)."""
    frames = len(load)
    rows = np.zeros_like(load)
    for k in range(frames):
        rows[k:] += pulse[: frames - k] * load[k]
    return rows


def driven(omega2: np.ndarray, decay: np.ndarray, period_s: float, load: np.ndarray, substeps: int) -> np.ndarray:
    """Displacements (T, r) at the frame times from rest under loads ((T - 1) substeps, r), each constant over its share of a frame; other arguments as for Step."""
    pulse = Step.of(omega2, decay, period_s / substeps).pulse(len(load) + 1)
    size = next_fast_len(len(pulse) + len(load) - 1, real=True)
    return np.asarray(irfft(rfft(pulse, size, axis=0) * rfft(load, size, axis=0), size, axis=0)[: len(load) + 1 : substeps])
