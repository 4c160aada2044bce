"""A body whose foot a floor holds."""

from __future__ import annotations

import numpy as np
import pytest

from diffphys_ros.elements.assemble import Elements
from diffphys_ros.elements.standing import Standing, foot_of, standing
from tests.made_bar import bar

YOUNG, DENSITY, LENGTH = 5.0e4, 900.0, 0.2


def of(poisson: float, up: tuple[float, float, float], length: float = LENGTH) -> tuple[Elements, Standing]:
    body = bar(length=length, height=0.05, thickness=0.06, edges=(), density=DENSITY, poisson=poisson, clamped=False, pitch=2.5e-3)
    elements = Elements.of(body)
    return elements, standing(elements, np.array([YOUNG]), np.array(up))


@pytest.mark.parametrize("up", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
def test_a_rod_that_does_not_widen_stretches_as_a_quarter_of_a_wave(up: tuple[float, float, float]) -> None:
    _, found = of(0.0, up)
    expected = np.sqrt(YOUNG / DENSITY) / (4 * LENGTH)
    assert found.stuck_hz == pytest.approx(expected, rel=0.005)
    assert found.sliding_hz == pytest.approx(expected, rel=0.005)


def test_a_foot_that_sticks_makes_it_faster_than_one_that_slides() -> None:
    _, found = of(0.4, (1.0, 0.0, 0.0), length=0.08)
    assert 1.01 < found.stuck_hz / found.sliding_hz < 1.1


def test_the_shape_moves_along_the_vertical_and_not_at_the_foot() -> None:
    elements, found = of(0.3, (0.0, 1.0, 0.0))
    foot = foot_of(elements.nodes, np.array([0.0, 1.0, 0.0]))
    assert foot.any()
    assert np.ptp(elements.nodes[foot, 1]) < 0.003
    top = elements.nodes[:, 1] > elements.nodes[:, 1].max() - 1e-6
    along = np.abs(found.shape[:, 1])
    assert along[foot].max() < 0.01 * along[top].mean()
    assert np.abs(found.shape[top][:, [0, 2]]).mean() < 0.5 * along[top].mean()
