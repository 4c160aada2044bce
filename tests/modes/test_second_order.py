"""Forces of second order against the strain energy that they are the slope of, and against a body of which they are known."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.hooke import lame
from diffphys_ros.modes import ModalModel, interpolation
from diffphys_ros.modes.response import Step, driven
from diffphys_ros.modes.second_order import SecondOrder
from tests.made_bar import YOUNG, bar, modes_of

PERIOD_S = 1 / 30


@pytest.fixture(scope="module")
def modal() -> ModalModel:
    return modes_of(bar(pitch=2e-3), YOUNG)


def strain_energy(modal: ModalModel, young: np.ndarray, q: np.ndarray) -> float:
    """Of the Green-Lagrange strain of a linear solid (St. Venant and Kirchhoff) [J]."""
    _, volume, _ = interpolation.quadrature(modal.nodes, modal.tets)
    slope = interpolation.at_quadrature(modal.nodes, modal.tets, modal.basis @ q)[1]
    part = np.repeat(modal.part, 4) - 1
    lam, mu = lame(young[part], modal.poisson[part])
    strain = 0.5 * (slope + np.swapaxes(slope, 1, 2) + slope @ np.swapaxes(slope, 1, 2))
    return float(volume @ (0.5 * lam * np.trace(strain, axis1=1, axis2=2) ** 2 + mu * (strain**2).sum((1, 2))))


def test_the_forces_are_the_slope_of_the_strain_energy_of_a_large_displacement(modal: ModalModel) -> None:
    """To second order: halved displacements leave an eighth of what is missed."""
    rng, leading = np.random.default_rng(0), 4
    swing = np.r_[rng.normal(size=leading), np.zeros(modal.modes - leading)]
    swing *= 2e-5 / np.abs(modal.basis @ swing).max()  # m; the third order is a hundred times the second at a hundred times that
    missed = []
    for size in (1.0, 0.5):
        q, slope = size * swing, np.zeros(modal.modes)
        for k, unit in enumerate(np.eye(modal.modes)):
            step = 1e-4 * np.abs(swing).max() * unit
            slope[k] = (strain_energy(modal, YOUNG, q + step) - strain_energy(modal, YOUNG, q - step)) / (2 * step[k])
        second = SecondOrder.of(modal, leading).load(YOUNG, q[None, :leading])[0]
        linear = modal.elastic(YOUNG) @ q
        missed.append(np.linalg.norm(slope - linear + second))
        if size == 1.0:
            assert missed[0] < 0.2 * np.linalg.norm(second)
    assert missed[1] == pytest.approx(missed[0] / 8, rel=0.1)


def test_a_bar_that_bends_in_two_planes_is_twisted_and_one_that_bends_in_one_is_not() -> None:
    """The product of the moment in each plane and the bend across it (Hodges and Dowell, NASA TN D-7818, 1974)."""
    modal = modes_of(bar(length=0.6, height=0.05, thickness=0.03, edges=(), pitch=1e-3), YOUNG[:1])
    slope = modal.evaluate(np.column_stack([np.linspace(0.02, 0.58, 57), np.zeros((57, 2))]))[1]
    twist = int(np.abs(slope[:, 2, 1] - slope[:, 1, 2]).max(0).argmax())
    coupling = np.abs(SecondOrder.of(modal, 2).coupling[0])
    assert coupling[twist, 0, 1] > 20 * np.delete(coupling[:, 0, 1], twist).max()
    assert coupling[twist, 0, 1] > 20 * max(coupling[twist, 0, 0], coupling[twist, 1, 1])


def test_loads_within_a_frame_drive_as_the_exact_steps_do() -> None:
    omega2, decay, rng = np.array([90.0, 4e3]), np.array([0.3, 2.0]), np.random.default_rng(0)
    load = rng.normal(size=(4 * 20, 2))
    step, state, exact = Step.of(omega2, decay, PERIOD_S / 4), np.zeros((2, 2)), [np.zeros(2)]
    for each in load:
        state = step(state, each)
        exact.append(state[0])
    np.testing.assert_allclose(driven(omega2, decay, PERIOD_S, load, 4), np.array(exact)[::4], atol=1e-12)
