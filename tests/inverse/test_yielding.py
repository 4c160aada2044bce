"""The two numbers that a large swing shows beyond one modulus and one drag, of a pendulum that has them."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.inverse.yielding import CalmSwing, Yielding, fitted

HZ, DRAG, FRAMES, FPS = 4.0, 2.0, 240, 240.0


def swing(law: Yielding, amplitude: float) -> np.ndarray:
    """Of a tip [px] whose frequency falls by its amplitude and whose decay grows with it."""
    at, phase, out = amplitude, 0.0, []
    for _ in range(FRAMES):
        out.append([at * np.cos(phase), 100.0])
        phase += 2 * np.pi * HZ * (1 - 0.5 * law.softens * 1e-3 * at) / FPS
        at *= np.exp(-(DRAG / 2 + law.drag_per_m * 2e-2 * at) / FPS)
    return np.array(out)


@pytest.mark.parametrize("law", [Yielding(0.4, 0.0), Yielding(0.0, 0.3), Yielding(0.5, 0.2)])
def test_a_large_swing_tells_both_numbers(law: Yielding) -> None:
    told = swing(law, 80.0)
    found = fitted(lambda one: swing(one, 80.0), told)
    assert found.law.softens == pytest.approx(law.softens, abs=0.03)
    assert found.law.drag_per_m == pytest.approx(law.drag_per_m, abs=0.03)
    assert np.abs(found.tip - told).max() < 0.05 * np.abs(found.constant - told).max()


def test_a_small_swing_tells_neither() -> None:
    rng = np.random.default_rng(0)
    told = swing(Yielding(), 0.5) + 0.05 * rng.standard_normal((FRAMES, 2))
    law = fitted(lambda one: swing(one, 0.5), told).law
    assert law.softens < 0.1
    assert law.drag_per_m < 0.1


def test_a_motion_that_cannot_be_simulated_is_none() -> None:
    assert fitted(lambda law: None, swing(Yielding(), 10.0)) is None


def test_a_law_leaves_the_calm_frames_their_frequency_and_decay() -> None:
    calm = CalmSwing(HZ, DRAG, 0.5, (0.999, -0.01))
    law = Yielding(0.4, 1.0)
    assert calm.small_hz(law) * (0.999 - 0.004) == pytest.approx(HZ)
    assert calm.drag(law) + law.drag_per_m * 0.5 == pytest.approx(DRAG)


def test_a_number_that_ends_at_its_bound_leaves_the_other_right() -> None:
    """Two numbers that do much the same: where one would have to be less than none, the other is what fits without it."""
    wave = 100.0 * np.stack([np.sin(np.arange(FRAMES)), np.cos(np.arange(FRAMES))], 1)
    first, second = wave[:, ::-1], 0.8 * wave[:, ::-1] + 0.6 * wave

    def moved(law: Yielding) -> np.ndarray:
        return wave + law.softens * first + law.drag_per_m * second

    law = fitted(moved, moved(Yielding(1.0, -0.5))).law
    assert law.drag_per_m == 0
    assert law.softens == pytest.approx(1.0 - 0.5 * (first * second).sum() / (first**2).sum(), rel=0.01)
