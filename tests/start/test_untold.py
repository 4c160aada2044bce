"""Poisson's ratios that nobody told, from a free motion in which the body twists."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.elements.assemble import Elements, modal_model
from diffphys_ros.start import start_values
from diffphys_ros.start.densities import Densities
from diffphys_ros.start.untold import MOST_POISSON, POISSON_SD, Ratios, Untold
from diffphys_ros.types import StartValues
from tests.made_bar import BETA, FORCED, FRAMES, PERIOD_S, SMALL, bar, blade, modes_of, push_on_its_corner, settings, tracks

YOUNG = np.array([1.2e6, 2.4e6])  # Pa: the outer part is the stiffer one, and hardly strains
RUBBER = 0.42


def twisted(told: list[float] | None) -> StartValues:
    """Of the motion after a blow on a corner, seen from the front; 0.3 is assumed where nothing is told."""
    truth = modes_of(blade(RUBBER), YOUNG, count=12)
    blow = np.zeros((FRAMES, 3))
    blow[FORCED.start : FORCED.start + 2] = SMALL * np.array([0.0, 6000.0, 5000.0])
    load = push_on_its_corner(truth, blow)
    q = truth.respond(YOUNG, damping=Damping(0.0, BETA), load=load, period_s=PERIOD_S)
    assumed = blade(told[0] if told else 0.3)
    return start_values(assumed, tracks(truth, q), PERIOD_S, settings(at_rest=True, poisson_ratio=told))[0]


@pytest.mark.slow
def test_a_twist_tells_poissons_ratio_which_would_else_be_taken_for_stiffness() -> None:
    found, wrong = twisted(None), twisted([0.3])
    assert abs(found.poisson[0] - RUBBER) < min(0.04, 2.5 * found.material.poisson_sd[0])
    assert found.material.poisson_sd[0] < 0.6 * POISSON_SD < found.material.poisson_sd[1]
    error, error_of_wrong = (np.abs(np.log10(each.young / YOUNG)) for each in (found, wrong))
    assert error.max() < 0.03
    assert error.max() < 0.5 * error_of_wrong.max()
    assert (error < 2.5 * found.log10_young_sd).all()
    np.testing.assert_array_equal(wrong.poisson, 0.3)


def test_another_ratio_makes_the_frequencies_of_a_body_that_has_it() -> None:
    """Against elements that are assembled with it; twisting exactly, bending to first order."""
    here, there = blade(0.3), blade(0.34)
    wide, exact = (modal_model(Elements.of(each), [YOUNG], [12]) for each in (here, there))
    squares = exact.eigen(YOUNG)[0][:4]
    np.testing.assert_allclose(wide.eigen(YOUNG, poisson=there.poisson)[0][:4], squares, rtol=3e-3)
    np.testing.assert_allclose(wide.squeezing(there.poisson).eigen(YOUNG)[0], wide.eigen(YOUNG, poisson=there.poisson)[0], rtol=1e-9)
    assert np.abs(wide.eigen(YOUNG)[0][:4] / squares - 1).max() > 0.01
    back = wide.squeezing(there.poisson).squeezing(here.poisson)
    np.testing.assert_allclose(back.eigen(YOUNG)[0], wide.eigen(YOUNG)[0], rtol=1e-9)


def test_elements_that_are_squeezed_are_those_of_such_a_body() -> None:
    squeezed, exact = Elements.of(blade(0.3)).squeezing(np.array([0.38, 0.2])), Elements.of(replace(blade(0.3), poisson=np.array([0.38, 0.2])))
    assert abs(squeezed.elastic(YOUNG) - exact.elastic(YOUNG)).max() < 1e-12 * abs(exact.elastic(YOUNG)).max()


def test_squares_and_shapes_change_with_the_ratio_as_the_derivatives_say() -> None:
    model = modal_model(Elements.of(blade(0.3)), [YOUNG], [8])
    ratio, step = np.array([0.36, 0.27]), 1e-5
    _, by_square, by_shape = model.eigen_changes(YOUNG, poisson=ratio)
    for part in range(2):
        up, down = (model.eigen(YOUNG, poisson=ratio + sign * step * (np.arange(2) == part)) for sign in (1, -1))
        np.testing.assert_allclose(by_square[2 + part], (up[0] - down[0]) / (2 * step), rtol=1e-5, atol=1e-5 * up[0].max())
        signs = np.sign((up[1] * down[1]).sum(0))
        np.testing.assert_allclose(by_shape[2 + part], (up[1] - down[1] * signs) / (2 * step), atol=1e-4)


def test_unknowns_of_densities_and_ratios_are_found_again_and_stay_physical() -> None:
    body = bar()
    untold = Untold(Densities(np.array([600.0, 600.0]), body.part_volumes_m3, 0.5), Ratios(np.array([0.3, 0.45]), np.array([0.1, 0.025])))
    density, poisson = untold.of(np.array([0.5, -0.5, 1.0, -2.0]))
    assert density is not None
    assert poisson is not None
    np.testing.assert_allclose(poisson, [0.4, 0.4])
    again = untold.of(untold.unknown(density, poisson))
    np.testing.assert_allclose(np.concatenate([density, poisson]), np.concatenate([each for each in again if each is not None]))
    low, high = untold.bounds()
    ends = [untold.of(each)[1] for each in (low, high)]
    np.testing.assert_allclose(np.array(ends), [[0.0, 0.0], [MOST_POISSON, MOST_POISSON]], atol=1e-12)
    assert Untold().size == 0
    assert Untold().of(np.zeros(0)) == (None, None)


def test_ratios_that_are_told_or_of_a_body_of_assumed_shape_are_not_sought() -> None:
    scene = settings().scene
    assumed = replace(bar(), sources=bar().sources | {"metric_scale": "unknown: the object is assumed 1 m away"})
    assert Ratios.open(bar(), scene) is not None
    assert Ratios.open(bar(), replace(scene, poisson_ratio=[0.3])) is None
    assert Ratios.open(assumed, scene) is None
