"""Forced frames and frequencies of a swing that is filmed far faster than it moves: read from means over several frames. numpy only.

From one frame to the next such a swing hardly bends, so that its second differences drown in noise; over a tenth of a period they do not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .forced_frames import Support, find_support

FRAMES_A_PERIOD = 12.0  # that are left: a recursion over neighbouring frames then turns by 30 degrees a step [chosen]
LEAST_KNOWN = 0.5  # of the frames of a mean that must be seen [chosen]
PADDING = 8  # of the spectrum [numerical]


def find_slow_support(coordinates: np.ndarray, known: np.ndarray, period_s: float, *, at_rest: bool, noise_m: float) -> Support:
    """As forced_frames.find_support, of the means over so many frames that FRAMES_A_PERIOD of them make a period of the leading coordinate."""
    coordinates = _without_gaps(coordinates, known)
    size = max(int(_period(coordinates[:, 0]) / FRAMES_A_PERIOD), 1)
    count = len(coordinates) // size
    if size == 1 or count < 2:
        return find_support(coordinates, known, period_s, at_rest=at_rest, noise_m=noise_m)
    used = size * count
    seen = known[:used].reshape(count, size).mean(1) >= LEAST_KNOWN
    means = coordinates[:used].reshape(count, size, -1).mean(1)
    found = find_support(means, seen, size * period_s, at_rest=at_rest, noise_m=noise_m / np.sqrt(size))
    forced = np.repeat(found.forced, size)
    forced = np.concatenate([forced, np.full(len(coordinates) - used, forced[-1])])
    return replace(found, forced=forced)


def _without_gaps(coordinates: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Coordinates (T, n) with frames that were not seen on straight lines between their neighbours: left out, they would move the time of a mean."""
    at, seen = np.arange(len(known)), np.flatnonzero(known)
    return coordinates if known.all() or not len(seen) else np.stack([np.interp(at, seen, column[seen]) for column in coordinates.T], 1)


def _period(q: np.ndarray) -> float:
    """Of the strongest oscillation [frames]."""
    power = np.abs(np.fft.rfft((q - q.mean()) * np.hanning(len(q)), PADDING * len(q)))
    frequency = np.fft.rfftfreq(PADDING * len(q))
    return float(1 / frequency[np.where(frequency < 1 / len(q), 0.0, power).argmax()])
