"""When a run has to end. The clock plans nothing (plan.py does, without it): it only stops what takes longer than it should."""

from __future__ import annotations

import time

import numpy as np

SLICED = 0.9  # of the time left that is dealt out: what is begun in a slice ends after it [numerical]
FIT_END, REFINE_END = 0.8, 0.9  # shares of the time after which neither search nor training, and then no Gaussians, go on: files are still to be written


class OutOfTimeError(Exception):
    """The time for search and training is over."""


class Clock:
    """Runs from when it is made. `limit_s` [s] is for the whole clip; infinite where nothing ends by the clock. `longest_s` [s]: the same where fields
    have to carry the video; never less."""

    def __init__(self, limit_s: float = np.inf, *, longest_s: float = 0.0) -> None:
        self.limit_s, self.longest_s, self._began = limit_s, max(limit_s, longest_s), time.monotonic()
        self.stopped = ""  # what it stopped, one sentence

    def within(self, share: float) -> Clock:
        """One that began with it, for a share of its time."""
        return self._until(share * self.limit_s)

    def longest(self) -> Clock:
        """One that began with it, for all the time that fields may have."""
        return self._until(self.longest_s)

    def _until(self, limit_s: float) -> Clock:
        other = Clock(limit_s)
        other._began = self._began
        return other

    def slice_end_s(self, pieces: float) -> float:
        """When the first of so many pieces of what is left for search and training must end, all of which are as long [s since the start]."""
        return self.spent_s + SLICED * max(FIT_END * self.limit_s - self.spent_s, 0.0) / pieces

    @property
    def spent_s(self) -> float:
        """Since the start [s]."""
        return time.monotonic() - self._began

    def allows_fit(self, seconds: float = 0.0) -> bool:
        """Whether so much more [s] can go into search or training."""
        return self.spent_s + seconds <= FIT_END * self.limit_s

    def allows_refinement(self) -> bool:
        """Whether Gaussians may still be fitted."""
        return self.spent_s <= REFINE_END * self.limit_s

    def check(self, share: float = 0.0) -> None:
        """Raises OutOfTimeError where search and training have to end; `share` of a simulation that is done, for its report."""
        if not self.allows_fit():
            raise OutOfTimeError
