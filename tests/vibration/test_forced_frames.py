"""Forced frames and frequencies from coordinates alone."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.modes.response import Step, convolve
from diffphys_ros.vibration.forced_frames import Rows, find_support

PERIOD_S, FRAMES = 1 / 30, 60
HZ, DECAY = np.array([1.9, 2.8]), np.array([0.1, 0.25])


def swings(force: np.ndarray, *, start: np.ndarray | None = None, noise: float = 3e-5, seed: int = 0) -> np.ndarray:
    """Coordinates (T, 2) of two oscillators that mix."""
    step = Step.of((2 * np.pi * HZ) ** 2, DECAY, PERIOD_S)
    q = convolve(step.pulse(FRAMES), force)
    if start is not None:
        q = q + step.history(start, FRAMES)
    mixed = q @ np.array([[0.9, 0.1], [-0.2, 0.8]]) + noise * np.random.default_rng(seed).standard_normal((FRAMES, 2))
    return mixed - mixed[0]


def pulse(first: int, last: int, peak: float = 1.2) -> np.ndarray:
    force = np.zeros((FRAMES, 2))
    rise = np.sqrt(np.sin(np.pi * (np.arange(first, last + 1) - first + 0.5) / (last - first + 1)))
    force[first : last + 1] = peak * rise[:, None] * (1.0, 0.7)
    return force


KNOWN = np.ones(FRAMES, bool)


@pytest.mark.parametrize(("first", "last"), [(3, 8), (3, 23), (10, 14)])
@pytest.mark.parametrize("seed", range(3))
def test_forced_frames_are_found_within_one_frame(first, last, seed):
    found = np.flatnonzero(find_support(swings(pulse(first, last), seed=seed), KNOWN, PERIOD_S, at_rest=True, noise_m=6e-5).forced)
    assert abs(found[0] - first) <= 1
    assert abs(found[-1] - last) <= 1
    assert len(found) == found[-1] - found[0] + 1


@pytest.mark.parametrize(("halves", "peak", "noise"), [(3, 0.9, 3e-5), (4, 0.6, 3e-5), (4, 1.5, 6e-5)])
@pytest.mark.parametrize("seed", range(3))
def test_a_force_that_swings_to_and_fro_is_not_taken_for_free_motion(halves, peak, noise, seed):
    """Half sines: where the force passes zero its equations look free, and a recursion that is fitted to them learns the force."""
    force = np.zeros((FRAMES, 2))
    force[3:25] = peak * np.sin(halves * np.pi * (np.arange(22) + 0.5) / 22)[:, None] * (1.0, 0.7)
    support = find_support(swings(force, noise=noise, seed=seed), KNOWN, PERIOD_S, at_rest=True, noise_m=noise)
    found = np.flatnonzero(support.forced)
    assert support.has_free_tail
    assert abs(found[0] - 3) <= 2
    assert abs(found[-1] - 24) <= 2
    assert len(found) == found[-1] - found[0] + 1


@pytest.mark.parametrize("seed", range(4))
def test_the_fainter_of_two_gusts_is_no_free_motion(seed):
    """Fitted to it, a recursion tells no frequency; with fainter forces left out it does."""
    force = pulse(3, 9, 0.9)
    force[13:24] = -0.6 * np.sin(np.pi * (np.arange(11) + 0.5) / 11)[:, None] * (1.0, 0.7)
    support = find_support(swings(force, seed=seed), KNOWN, PERIOD_S, at_rest=True, noise_m=3e-5)
    assert support.has_free_tail
    assert -4 <= support.tail_start - 25 <= 2


def test_frequencies_and_decays_are_read_off_the_tail():
    support = find_support(swings(pulse(3, 10), noise=5e-6), KNOWN, PERIOD_S, at_rest=True, noise_m=1e-5)
    assert support.has_free_tail
    order = np.argsort(support.frequencies_hz)
    assert support.frequencies_hz[order] == pytest.approx(HZ, rel=5e-3)
    assert support.decay_per_s[order] == pytest.approx(DECAY, abs=0.1)


def test_a_body_let_go_has_no_forced_frame():
    start = np.array([[0.02, 0.006], [0.0, 0.1]])
    support = find_support(swings(np.zeros((FRAMES, 2)), start=start), KNOWN, PERIOD_S, at_rest=False, noise_m=6e-5)
    assert support.has_free_tail
    assert not support.forced.any()


def test_a_force_that_never_ends_leaves_no_free_tail():
    rng = np.random.default_rng(2)
    support = find_support(swings(1.0 * rng.standard_normal((FRAMES, 2))), KNOWN, PERIOD_S, at_rest=True, noise_m=6e-5)
    assert not support.has_free_tail


def test_lost_frames_are_stepped_over():
    q = swings(pulse(3, 10))
    known = KNOWN.copy()
    known[[20, 33]] = False
    q[~known] = 0.0
    support = find_support(q, known, PERIOD_S, at_rest=True, noise_m=6e-5)
    assert np.abs(np.flatnonzero(support.forced)[[0, -1]] - (3, 10)).max() <= 1


def test_a_clip_too_short_for_a_recursion_has_no_free_tail():
    support = find_support(swings(pulse(1, 4))[:9], KNOWN[:9], PERIOD_S, at_rest=True, noise_m=6e-5)
    assert not support.has_free_tail
    assert support.forced.all()


def test_nine_frames_of_a_body_that_is_being_pushed_are_no_free_tail():
    q = swings(pulse(0, 20), noise=0.0)[:9, :1]
    noisy = q + 3e-5 * np.random.default_rng(0).standard_normal(q.shape)
    support = find_support(noisy - noisy[0], KNOWN[:9], PERIOD_S, at_rest=False, noise_m=6e-5)
    assert len(support.frequencies_hz)  # the recursion swings, but grows
    assert support.decay_per_s[0] < 0
    assert not support.has_free_tail


def test_frames_that_do_not_tell_a_frequency_are_no_free_tail_and_more_of_them_are():
    """One oscillator under noise: the frequency read from few frames is worth no modulus."""
    time = np.arange(FRAMES) * PERIOD_S
    truth = 5e-3 * np.exp(-0.1 * time) * np.cos(2 * np.pi * 3.5 * time + 1.0)
    free, error = {}, {}
    for count, noise in ((9, 1.5e-3), (9, 2e-5), (FRAMES, 2e-5)):
        found = []
        for seed in range(8):
            q = (truth + noise * np.random.default_rng(seed).standard_normal(FRAMES))[:count, None]
            found.append(find_support(q - q[0], KNOWN[:count], PERIOD_S, at_rest=False, noise_m=2 * noise))
        free[count, noise] = np.mean([s.has_free_tail for s in found])
        error[count, noise] = np.median([abs(s.frequencies_hz[0] / 3.5 - 1) if len(s.frequencies_hz) else 1.0 for s in found])
    assert free == {(9, 1.5e-3): 0, (9, 2e-5): 1, (FRAMES, 2e-5): 1}
    assert error[9, 1.5e-3] > 0.05
    assert max(error[9, 2e-5], error[FRAMES, 2e-5]) < 0.01


@pytest.mark.parametrize("lost", [[3, 7], [5], [4, 9, 20], [9, 10, 11], [24, 40]])
@pytest.mark.parametrize("seed", range(2))
def test_lost_frames_hide_no_forced_one(lost, seed):
    known = KNOWN.copy()
    known[lost] = False
    q = swings(pulse(3, 11) + pulse(13, 23), seed=seed)  # almost no force between the two
    q[lost] = q[np.array(lost) - 1]
    found = np.flatnonzero(find_support(q, known, PERIOD_S, at_rest=True, noise_m=6e-5).forced)
    assert set(range(4, 23)) <= set(found.tolist())
    assert found[0] >= 0
    assert found[-1] <= 27


def test_lost_frames_in_the_tail_are_no_force():
    known = KNOWN.copy()
    known[[30, 31, 42, 50]] = False
    found = np.flatnonzero(find_support(swings(pulse(3, 8)), known, PERIOD_S, at_rest=True, noise_m=6e-5).forced)
    assert found[-1] <= 9


def let_go(decay_per_s: float, noise: float) -> np.ndarray:
    """How often (of 6) a swing of 3.5 Hz that decays so is a free tail."""
    time = np.arange(FRAMES) * PERIOD_S
    truth = 5e-3 * np.exp(-decay_per_s * time) * np.cos(2 * np.pi * 3.5 * time + 1.0)
    seen = (truth + noise * np.random.default_rng(seed).standard_normal(FRAMES) for seed in range(6))
    return np.mean([find_support((q - q[0])[:, None], KNOWN, PERIOD_S, at_rest=False, noise_m=2 * noise).has_free_tail for q in seen])


def test_a_swing_that_grows_is_pushed_and_one_that_noise_lets_seem_to_grow_is_not():
    """By half over the clip, and by a quarter."""
    assert let_go(-0.2, 2e-5) == 0
    assert let_go(-0.1, 2e-5) == 1
    assert let_go(-0.3, 2e-4) > 0.8


def test_a_frame_that_was_seen_wrongly_is_no_force():
    q = swings(pulse(3, 8))
    q[30] += 2e-3
    support = find_support(q, KNOWN, PERIOD_S, at_rest=True, noise_m=6e-5)
    assert support.has_free_tail
    assert np.flatnonzero(support.forced)[-1] <= 9


def test_coordinates_that_are_sums_of_others_leave_the_frequency_a_finite_deviation() -> None:
    """The inverse of their normal matrix has eigenvalues that rounding puts below zero."""
    clock = PERIOD_S * np.arange(60)
    wave = 1e-7 * np.exp(-clock)[:, None] * np.column_stack([np.cos(12 * clock), np.sin(12 * clock)])
    rows = Rows.of(wave @ np.random.default_rng(0).standard_normal((2, 9)), np.ones(60, bool), at_rest=True)
    keep = np.ones(len(rows.target), bool)
    assert np.isfinite(rows.leading_sd(keep, rows.fit(keep), wave @ np.eye(2, 9), 1e-9)).all()
