"""A small error of stiffness turns modes of nearly one frequency, and no others."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.differences import differences
from diffphys_ros.modes.detuned import NEAR, Detuned

COUPLING = np.array([4e-3, -2e-3, 5e-3])
STILL = np.zeros(4)


def matrix(omega2: np.ndarray, detune: np.ndarray, coupling: np.ndarray) -> np.ndarray:
    return Detuned.of(omega2, detune, coupling).change + np.diag(omega2[: len(detune)])


def test_modes_that_are_not_coupled_keep_their_shapes_and_swing_as_much_faster() -> None:
    detune = np.array([0.02, -0.01, 0.0, 0.0])
    squares, shapes = Detuned.of(np.array([1.0, 1.0, 4.0, 9.0, 16.0]), detune, np.zeros(3)).leading(np.array([1.0, 1.0, 4.0, 9.0, 16.0]), np.eye(5))
    np.testing.assert_allclose(squares, [np.exp(0.04), np.exp(-0.02), 4.0, 9.0, 16.0])
    np.testing.assert_array_equal(shapes, np.eye(5))


def test_two_modes_of_one_frequency_are_turned_half_way_and_part_by_their_coupling() -> None:
    found = Detuned.of(np.array([100.0, 100.0, 900.0, 2500.0]), STILL, np.array([0.003, 0.0, 0.0]))
    np.testing.assert_allclose(np.sqrt(found.squares[:2]), 10.0 * (1 + np.array([-0.003, 0.003])), rtol=1e-5)
    np.testing.assert_allclose(np.abs(found.turn[:2, :2]), np.sqrt(0.5))
    np.testing.assert_allclose(found.turn.T @ found.turn, np.eye(4), atol=1e-12)


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_two_modes_turn_by_their_coupling_over_the_gap_between_them_and_hardly_where_they_are_far_apart(share: float) -> None:
    gap = share * NEAR
    found = Detuned.of(np.array([100.0, 100.0 * np.exp(2 * gap), 900.0, 2500.0]), STILL, np.array([1e-4, 0.0, 0.0]))
    close = np.exp(-0.5 * share**2)
    assert abs(found.turn[0, 1]) == pytest.approx(2 * close * 1e-4 * np.exp(gap) / np.expm1(2 * gap), rel=1e-3)


def test_what_does_not_swing_is_coupled_to_nothing() -> None:
    found = Detuned.of(np.array([-5.0, 0.0, 100.0, 101.0]), STILL, COUPLING)
    np.testing.assert_array_equal(found.turn[:2, :2], np.eye(2))
    np.testing.assert_array_equal(found.squares[:2], 0.0)
    assert np.isfinite(found.by_squares(np.ones((2, 4)))).all()


@pytest.mark.parametrize("omega2", [np.array([100.0, 101.0, 106.0, 140.0]), np.array([100.0, 103.0])])
def test_the_slopes_are_what_differences_find(omega2: np.ndarray) -> None:
    detune, coupling = np.array([0.01, -0.02, 0.005, 0.0]), COUPLING
    found, count = Detuned.of(omega2, detune, coupling), len(omega2)
    np.testing.assert_allclose(np.moveaxis(found.by_squares(np.eye(count)), 0, -1), differences(lambda s: matrix(s, detune, coupling), omega2), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(np.moveaxis(found.by_detune(), 0, -1), differences(lambda d: matrix(omega2, np.r_[d, detune[count:]], coupling), detune[:count]), rtol=1e-5, atol=1e-6)
    by_coupling = np.moveaxis(found.by_coupling(3), 0, -1)
    np.testing.assert_allclose(by_coupling, differences(lambda c: matrix(omega2, detune, c), coupling), rtol=1e-5, atol=1e-6)
    by_square, mixed = found.slopes(np.moveaxis(by_coupling, -1, 0))
    by_turn = found.turn @ mixed
    np.testing.assert_allclose(by_square.T, differences(lambda c: Detuned.of(omega2, detune, c).squares, coupling), rtol=1e-4, atol=1e-4)
    projected = by_turn @ found.turn.T
    projector = differences(lambda c: np.outer(*2 * (Detuned.of(omega2, detune, c).turn[:, 0],)), coupling)
    own = by_turn[:, :, 0, None] * found.turn[:, 0]
    np.testing.assert_allclose(np.moveaxis(own + np.swapaxes(own, 1, 2), 0, -1), projector, rtol=1e-4, atol=1e-3)
    assert np.abs(projected + np.swapaxes(projected, 1, 2)).max() < 1e-9 * max(np.abs(projected).max(), 1.0), "a turn stays one"
