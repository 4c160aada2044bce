"""Finite elements against beam theory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.errors import InputError
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.types import Body
from tests.made_bar import bar

YOUNG, DENSITY = 6e5, 600.0


def timoshenko_hz(*, length: float, height: float, poisson: float) -> float:
    """First bending frequency of a cantilever: stiffness and shear in series, Rayleigh's rotary inertia (Timoshenko 1974)."""
    inertia, shear = height**2 / 12, YOUNG / (2 * (1 + poisson)) * 5 / 6
    bending = 1.8751**4 * YOUNG * inertia / (DENSITY * length**4)  # omega^2 of Euler and Bernoulli
    rotary = inertia * 4.648 / length**2  # integral of phi'^2 over that of phi^2, times L^2: 4.648
    slip = YOUNG * inertia / shear * 4.648 / length**2  # the same with shear
    return np.sqrt(bending / (1 + rotary + slip)) / (2 * np.pi)


def first_modes(count: int = 4, **shape: object) -> np.ndarray:
    model = modal_model(Elements.of(bar(edges=(), density=DENSITY, **shape)), [np.array([YOUNG])], [count])
    return model.frequencies(np.array([YOUNG]))


@pytest.mark.parametrize("poisson", [0.0, 0.3])
def test_a_cantilever_bends_at_timoshenko_frequency_within_one_and_a_half_percent(poisson):
    shape = {"length": 0.5, "height": 0.05, "poisson": poisson}
    assert first_modes(thickness=0.08, **shape)[0] == pytest.approx(timoshenko_hz(**shape), rel=0.015)


def test_it_bends_through_the_thickness_at_the_same_frequency_as_in_the_plane():
    found = first_modes(length=0.4, height=0.06, thickness=0.06)
    assert found[1] == pytest.approx(found[0], rel=2e-3)


def leaf_on_a_stem(stem_m: float) -> Body:
    """A stem of that thickness, its leaf ten times as thick as one of 2 mm."""
    body = bar(length=0.14, height=0.06, thickness=0.02, edges=(), density=DENSITY, pitch=1e-3)
    x, y = (body.origin[i] + np.arange(n) * body.pitch_m for i, n in enumerate(body.inside.shape))
    stem = np.broadcast_to((x < 0.08)[:, None], body.inside.shape)
    return replace(body, inside=~stem | (np.abs(y) < 0.012)[None], half_thickness=np.where(stem, stem_m / 2, body.half_thickness))


def test_a_stem_much_thinner_than_its_leaf_bends_as_it_is():
    """As a spring of its thickness cubed, under a leaf that bends hardly at all."""
    thin, half = (modal_model(Elements.of(leaf_on_a_stem(stem)), [np.array([YOUNG])], [1]).frequencies(np.array([YOUNG]))[0] for stem in (2e-3, 1e-3))
    assert thin / half == pytest.approx(2**1.5, rel=0.02)


def column(gravity_x: float) -> tuple[ModalModel, np.ndarray]:
    young = np.array([YOUNG])
    body = bar(length=0.5, height=0.05, thickness=0.08, edges=(), density=DENSITY, poisson=0.0, gravity=(gravity_x, 0.0, 0.0))
    return modal_model(Elements.of(body), [young], [4]), young


@pytest.mark.slow
def test_hanging_raises_and_standing_lowers_the_first_frequency_by_the_share_of_the_buckling_weight():
    plain = column(0.0)
    hanging, standing = column(9.81), column(-9.81)
    square = [float(m.eigen(e)[0][0]) for m, e in (plain, hanging, standing)]
    # a column buckles under its own weight at q L^3 / E I = 7.837 (Timoshenko and Gere), and omega^2 falls linearly up to there
    share = DENSITY * 9.81 * 0.5**3 / (YOUNG * 0.05**2 / 12) / 7.837
    assert square[1] / square[0] - 1 == pytest.approx(share, rel=0.06)
    assert 1 - square[2] / square[0] == pytest.approx(share, rel=0.06)


def test_a_column_that_is_too_soft_shows_a_negative_square():
    model, young = column(-9.81)
    assert model.eigen(0.9 * young)[0][0] > 0
    assert model.eigen(0.5 * young)[0][0] < 0


def test_static_sag_under_gravity_is_that_of_a_beam():
    body = bar(length=0.5, height=0.05, thickness=0.08, edges=(), density=DENSITY, poisson=0.0, gravity=(0.0, -9.81, 0.0))
    young = np.array([YOUNG])
    model = modal_model(Elements.of(body), [young], [4])
    tip = model.evaluate(np.array([[0.5, 0.0, 0.0]]))[0][0] @ model.gravity_coordinates(young)
    inertia, area, shear = 0.05**3 / 12, 0.05, YOUNG / 2 * 5 / 6
    expected = -9.81 * DENSITY * area * (0.5**4 / (8 * YOUNG * inertia) + 0.5**2 / (2 * shear * area))
    assert tip[1] == pytest.approx(expected, rel=0.015)


def test_the_reduced_model_keeps_frequencies_at_ratios_between_those_of_its_basis():
    elements, base = Elements.of(bar()), np.array([2e5, 1e5])
    model = modal_model(elements, [base, base * (1, 0.35), base * (1, 3.0)], [6, 6, 6])
    exact = modal_model(elements, [base * (1, 0.6)], [6])
    assert model.frequencies(base * (1, 0.6))[:3] == pytest.approx(exact.frequencies(base * (1, 0.6))[:3], rel=1e-4)


def test_a_body_that_ends_before_its_clamped_plane_is_refused_not_left_to_float():
    body = bar()
    inside = body.inside.copy()
    inside[: len(inside) // 8] = False
    with pytest.raises(InputError, match="does not reach its clamped plane"):
        Elements.of(replace(body, inside=inside))


def test_a_free_body_has_six_rigid_motions():
    body = bar(edges=(), clamped=False)
    young = np.array([YOUNG])
    squares = modal_model(Elements.of(body), [young], [9]).eigen(young)[0]
    assert np.abs(squares[:6]).max() < 1e-4 * squares[6]
