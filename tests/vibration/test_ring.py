"""One damped swing in one coordinate."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.vibration.ring import LEAST_FRAMES, ring_of

PERIOD_S = 1 / 30
TIMES = np.arange(36) * PERIOD_S


def swing(hz: float, *, decay: float = 2.0, drift: float = 0.0, noise: float = 0.03, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.exp(-decay * TIMES) * np.cos(2 * np.pi * hz * TIMES + 0.7) + drift * TIMES + 0.4 + noise * rng.standard_normal(len(TIMES))


@pytest.mark.parametrize("hz", [2.5, 6.3, 9.4, 13.2])
def test_a_damped_swing_on_a_drift_is_found_by_frequency_and_decay(hz: float) -> None:
    found = ring_of(swing(hz, drift=0.8), PERIOD_S)
    assert found is not None
    assert abs(found.hz - hz) < 0.05
    assert abs(found.decay_per_s - 2.0) < 0.5


def test_the_stated_deviation_of_the_frequency_is_that_of_its_errors() -> None:
    found = [ring_of(swing(7.7, noise=0.1, seed=seed), PERIOD_S) for seed in range(40)]
    off = np.array([(ring.hz - 7.7) / ring.hz_sd for ring in found if ring is not None])
    assert len(off) > 30
    assert 0.7 < np.sqrt((off**2).mean()) < 1.4


def test_frames_that_are_not_known_are_left_out() -> None:
    q = swing(9.4, noise=0.0)
    q[[3, 4, 17]] = np.nan
    found = ring_of(q, PERIOD_S)
    assert found is not None
    assert abs(found.hz - 9.4) < 1e-3


@pytest.mark.parametrize("hz", [14.8, 0.6])
def test_a_swing_near_half_the_frame_rate_or_slower_than_the_frames_show_is_none(hz: float) -> None:
    assert ring_of(swing(hz, decay=0.3), PERIOD_S) is None


def test_noise_and_stillness_and_few_frames_are_no_swing() -> None:
    assert ring_of(np.random.default_rng(1).standard_normal(len(TIMES)), PERIOD_S) is None
    assert ring_of(np.zeros(len(TIMES)), PERIOD_S) is None
    assert ring_of(swing(9.4)[: LEAST_FRAMES - 1], PERIOD_S) is None
