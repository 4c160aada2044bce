"""Claims about what a fit of the free frames may miss."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.start.evidence import Evidence
from diffphys_ros.start.free_tail import DETUNED, Physics, Tail
from diffphys_ros.start.tail_errors import TailErrors
from diffphys_ros.start.uncertainty import LEADING, UNSEEN_SD
from diffphys_ros.vibration.coordinates import observe
from diffphys_ros.vibration.forced_frames import find_support
from tests.made_bar import BETA, PERIOD_S, YOUNG, bar, gust, modes_of, motion, settings, tracks

FRAMES, WIDTH = 9, 5


def drawn(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Noise of a frame, motion of three modes, errors of their shapes, and two other errors."""
    rng = np.random.default_rng(seed)
    noise, shapes = (mixed @ mixed.T for mixed in rng.normal(size=(2, WIDTH, WIDTH)))
    return noise, 3.0 * rng.normal(size=(FRAMES, 3)), shapes, 2.0 * rng.normal(size=(FRAMES * WIDTH, 2))


def test_what_may_be_missed_is_independent_and_of_unit_variance_when_it_is_whitened() -> None:
    noise, swings, shapes, others = drawn()
    covariance = np.kron(np.eye(FRAMES), noise) + np.kron(swings @ swings.T, shapes) + others @ others.T
    white = TailErrors.of(noise, swings, shapes, others).whitened(np.eye(FRAMES * WIDTH))
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(FRAMES * WIDTH), atol=1e-8)


def test_noise_alone_weighs_every_frame_alike() -> None:
    noise, swings, shapes, others = drawn()
    errors = TailErrors.of(noise, 0 * swings, shapes, others[:, :0])
    misfit = np.zeros((FRAMES, WIDTH))
    misfit[4, 2] = 1.0
    found = (errors.whitened(misfit.reshape(-1, 1)) ** 2).sum()
    assert found == pytest.approx(np.linalg.inv(noise)[2, 2])


def bar_tail() -> tuple[Tail, Physics]:
    """The free frames of a bar that is followed exactly, and its physics."""
    body, modal = bar(), modes_of(bar(), YOUNG)
    seen = tracks(modal, motion(modal, YOUNG, gust()))
    observed = observe(body, seen, None)
    support = find_support(observed.coordinates, observed.known, PERIOD_S, at_rest=True, noise_m=observed.noise_m)
    tail = Evidence(body, seen, observed, PERIOD_S, settings(at_rest=True)).tail(modal, support)
    return tail, Physics(YOUNG, Damping(0.0, BETA), np.zeros(DETUNED))


def off_by(shapes: float, noise: float, seed: int = 1) -> tuple[Tail, Physics, np.ndarray]:
    """The same where the leading shape is off, beside the leading ones, by a share of its size, and frames by as much noise; and the projection onto what the
    leading ones leave."""
    tail, physics = bar_tail()
    rng, width = np.random.default_rng(seed), tail.data.shape[1]
    smooth = tail.smooth(physics, LEADING)
    rest = np.eye(width) - smooth @ smooth.T
    wrong = rest @ rng.normal(size=width)
    leading = tail.swings(physics)[:, tail.leading_mode(YOUNG)]
    fitted = tail.data - tail.misfit(physics)
    made = fitted + shapes * np.outer(leading, wrong / np.linalg.norm(wrong)) + noise * tail.size_m * rng.normal(size=fitted.shape) / np.sqrt(width)
    data = tail.seen.data.copy()
    data[np.flatnonzero(tail.known & (np.arange(len(tail.known)) >= tail.first))] = made
    return replace(tail, seen=replace(tail.seen, data=data)), physics, rest


def test_shapes_that_are_off_beside_the_leading_ones_are_told_from_noise() -> None:
    tail, physics, rest = off_by(shapes=0.03, noise=0.02)
    leading = tail.swings(physics)[:, tail.leading_mode(YOUNG)]
    assert np.sqrt(tail.rough(physics, rest)) == pytest.approx(0.03 * np.sqrt((leading**2).mean()) / tail.size_m, rel=0.2)
    tail, physics, rest = off_by(shapes=0.0, noise=0.02)
    assert np.sqrt(tail.rough(physics, rest)) < 0.006


def test_an_error_of_shapes_counts_as_one_however_many_frames_show_it() -> None:
    tail, physics, _ = off_by(shapes=0.03, noise=0.002)
    missed, none = tail.misfit(physics).reshape(-1, 1) / tail.sigma_m, np.zeros((tail.data.size, 0))
    by_frames = TailErrors.of(tail.noise(physics), 0 * tail.swings(physics), np.eye(tail.data.shape[1]), none)
    weighed, counted = ((errors.whitened(missed) ** 2).sum() for errors in (TailErrors.if_right(tail, physics, none), by_frames))
    assert counted > 50 * len(tail.data)
    assert weighed < len(tail.data)


def test_a_leading_shape_is_held_to_what_a_fit_takes_on_unseen() -> None:
    tail, physics = bar_tail()
    errors = TailErrors.if_right(tail, physics, np.zeros((tail.data.size, 0)))
    leading = tail.smooth(physics, LEADING)[:, 0]
    mode = tail.leading_mode(YOUNG)
    off = np.outer(tail.swings(physics)[:, mode], leading).reshape(-1, 1) / tail.sigma_m
    sizes = [float((errors.whitened(scale * off) ** 2).sum()) for scale in (UNSEEN_SD / np.sqrt(LEADING), UNSEEN_SD)]
    assert 0.3 < sizes[0] < 1.05
    assert sizes[1] == pytest.approx(LEADING * sizes[0])


def test_what_differs_from_point_to_point_leaves_no_room_for_shapes_that_bend() -> None:
    """Each point is followed a little too far or too short; nothing that bends looks so. Spread over all directions it hid borders between materials."""
    tail, physics, rest = off_by(shapes=0.0, noise=0.002)
    bent = tail.bent()
    axes = np.linalg.svd(np.eye(len(bent)) - bent)
    assert axes[1][0] > 0.5
    leading = tail.swings(physics)[:, tail.leading_mode(YOUNG)]
    by_point = np.outer(leading, axes[0][:, 0])
    data = tail.seen.data.copy()
    data[np.flatnonzero(tail.known & (np.arange(len(tail.known)) >= tail.first))] += 0.03 * by_point
    tail = replace(tail, seen=replace(tail.seen, data=data))
    errors = TailErrors.if_right(tail, physics, np.zeros((tail.data.size, 0)))
    bending = np.linalg.svd(rest @ bent @ rest)[0][:, 0]
    sizes = [float((errors.whitened(misfit.reshape(-1, 1) / tail.sigma_m) ** 2).sum()) for misfit in (0.03 * by_point, 0.005 * np.outer(leading, bending))]
    assert sizes[0] < 5.0  # one error, as large as is found; the modes swing by several functions of time
    assert sizes[1] > 25.0
