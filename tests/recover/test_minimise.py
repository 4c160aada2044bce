"""Quasi-Newton search."""

import numpy as np
import pytest

from diffphys_ros.recover.minimise import begin, minimise, update_inverse


class Quadratic:
    """0.5 (z - 1)^T H (z - 1)."""

    def __init__(self, hessian, z):
        self.hessian, self.z = hessian, z
        self.value = float(0.5 * (z - 1) @ hessian @ (z - 1))

    def gradient(self):
        return self.hessian @ (self.z - 1)


def free(z, step):
    return 1.0


def ill_conditioned(n=6):
    rng = np.random.default_rng(0)
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return q @ np.diag(np.geomspace(1, 1e4, n)) @ q.T


def test_the_true_hessian_reaches_the_minimum_in_one_step():
    hessian = ill_conditioned()
    state = begin(lambda z: Quadratic(hessian, z), np.zeros(6), hessian)
    state = next(minimise(lambda z: Quadratic(hessian, z), state, iterations=1, limit=free))
    np.testing.assert_allclose(state.z, 1, atol=1e-10)


def test_a_hessian_wrong_by_a_factor_is_learnt():
    hessian = ill_conditioned()
    state = begin(lambda z: Quadratic(hessian, z), np.zeros(6), hessian * 0.3)
    last = list(minimise(lambda z: Quadratic(hessian, z), state, iterations=30, limit=free))[-1]
    assert last.value < 1e-6 * 0.5 * np.ones(6) @ hessian @ np.ones(6)


def test_values_never_rise_and_a_continued_search_equals_an_uninterrupted_one():
    def evaluate(z):
        return Quadratic(ill_conditioned(), z)

    start = begin(evaluate, np.zeros(6), np.eye(6) * 50)
    whole = list(minimise(evaluate, start, iterations=10, limit=free))
    assert all(b <= a for a, b in zip(whole[-1].history, whole[-1].history[1:], strict=False))
    again = list(minimise(evaluate, whole[3], iterations=10, limit=free))[-1]
    np.testing.assert_array_equal(again.z, whole[-1].z)


def test_the_limit_shortens_a_step():
    state = begin(lambda z: Quadratic(np.eye(2), z), np.zeros(2), np.eye(2))
    state = next(minimise(lambda z: Quadratic(np.eye(2), z), state, iterations=1, limit=lambda z, step: 0.5))
    np.testing.assert_allclose(state.z, 0.5)


def test_a_value_that_is_not_finite_is_backed_away_from():
    class Walled(Quadratic):
        def __init__(self, z):
            super().__init__(np.eye(1), z)
            if z[0] > 0.6:
                self.value = float("inf")

    state = begin(Walled, np.zeros(1), np.eye(1))
    state = next(minimise(Walled, state, iterations=1, limit=free))
    assert 0 < state.z[0] <= 0.6


def test_updates_satisfy_the_secant_condition_and_skip_negative_curvature():
    rng = np.random.default_rng(1)
    step, change = rng.normal(size=4), rng.normal(size=4)
    change *= np.sign(step @ change)
    np.testing.assert_allclose(update_inverse(np.eye(4), step, change) @ change, step)
    np.testing.assert_array_equal(update_inverse(np.eye(4), step, -change), np.eye(4))


def test_no_progress_ends_the_search():
    state = begin(lambda z: Quadratic(np.eye(2), z), np.ones(2), np.eye(2))
    assert len(list(minimise(lambda z: Quadratic(np.eye(2), z), state, iterations=50, limit=free))) <= 3
    assert state.value == pytest.approx(0)
