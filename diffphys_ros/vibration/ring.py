"""One damped swing in one coordinate: its frequency, and how sure it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

DECAYS = (0.0, 1.0, 2.0, 4.0, 8.0)  # [1/s], that a search begins with [numerical]
FINE = 8  # frequencies tried over what one more swing in all the frames makes [numerical]
NEAR_NYQUIST = 0.95  # of half the frame rate, above which a swing looks like its own mirror [chosen]
LEAST_SWINGS = 2.0  # in the frames: a slower one cannot be told from a drift [chosen]
MOST_MISSED = 0.35  # of the coordinate's rms about its drift [chosen]
LEAST_FRAMES = 10  # that a swing's four numbers and a drift's two are read from [chosen]


@dataclass(frozen=True)
class Ring:
    """q(t) = exp(-decay t) (a cos 2 pi hz t + b sin 2 pi hz t) + c + d t."""

    hz: float  # as it is sampled: one above half the frame rate looks like its mirror below
    hz_sd: float  # by what is missed
    decay_per_s: float
    missed: float  # rms over that of the coordinate about its drift


def ring_of(q: np.ndarray, period_s: float) -> Ring | None:
    """The damped swing of a coordinate (F,), NaN where it is not known; None where no swing explains it."""
    known = np.isfinite(q)
    times, values = np.flatnonzero(known) * period_s, q[known]
    if len(values) < LEAST_FRAMES:
        return None
    drift = np.stack([np.ones_like(times), times], 1)
    size = float(np.linalg.norm(_left(drift, values)))
    span = float(np.ptp(times))
    tried = np.arange(LEAST_SWINGS, NEAR_NYQUIST * 0.5 / period_s * span, 1 / FINE) / span
    if size == 0 or not len(tried):
        return None

    def missed(of: np.ndarray) -> np.ndarray:
        return _left(np.column_stack([_swing(times, *of), drift]), values)

    grid = np.array([(hz, decay) for hz in tried for decay in DECAYS])
    begin = grid[int(np.argmin([np.linalg.norm(missed(each)) for each in grid]))]
    found = least_squares(missed, begin, bounds=([0.2 / span, -1.0], [0.5 / period_s, np.inf]), x_scale=[1 / span, 1 / span])
    left = float(np.linalg.norm(found.fun))
    if left > MOST_MISSED * size or not tried[0] <= found.x[0] <= NEAR_NYQUIST * 0.5 / period_s:
        return None
    spare = max(len(values) - 6, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * left**2 / spare
    return Ring(float(found.x[0]), float(np.sqrt(max(covariance[0, 0], 0.0))), float(found.x[1]), left / size)


def _swing(times: np.ndarray, hz: float, decay: float) -> np.ndarray:
    phase = 2 * np.pi * hz * times
    return np.asarray(np.exp(-decay * times)[:, None] * np.stack([np.cos(phase), np.sin(phase)], 1))


def _left(terms: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.asarray(values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0])
