"""A swing that is filmed far faster than it moves, with frames that were lost."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.vibration.thinning import find_slow_support

PERIOD_S, HZ, DECAY = 1 / 240, 4.9, 1.0


@pytest.mark.parametrize("every", [12, 5, 3])
def test_lost_frames_do_not_end_a_free_swing(every: int) -> None:
    """Means over the frames that are left are those of another moment: every 12th one lost, a film had no free swing at all."""
    times = np.arange(150) * PERIOD_S
    swing = 3e-3 * np.exp(-DECAY * times) * np.sin(2 * np.pi * HZ * times)
    known = (np.arange(150) + 1) % every > 0
    noisy = np.where(known, swing + np.random.default_rng(0).normal(0, 5e-6, 150), 1.0)  # nothing is read where nothing was seen
    found = find_slow_support(noisy[:, None], known, PERIOD_S, at_rest=False, noise_m=5e-6)
    assert found.has_free_tail
    assert not found.forced.any()
    assert found.frequencies_hz[0] == pytest.approx(HZ, rel=3e-3)
