"""What densities and Poisson's ratios that nobody told do to stiffness, on bars whose parts are heavier and lighter than assumed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.elements.assemble import Elements
from diffphys_ros.start import start_values
from diffphys_ros.start.densities import DENSITY_CONTRAST
from diffphys_ros.start.free_tail import Physics
from diffphys_ros.start.material_doubt import mode_changes
from diffphys_ros.start.untold import POISSON_SD
from diffphys_ros.types import Body, StartValues
from tests.made_bar import PERIOD_S, YOUNG, bar, gust, modes_of, motion, settings, tracks

pytestmark = pytest.mark.slow


def started(contrast: float, **scene: object) -> StartValues:
    """Of a bar whose part at the clamp is heavier than the mean by a factor exp(contrast), of the same mass in all."""
    even = bar()
    volume, heavier = even.part_volumes_m3, even.density[0] * np.exp(contrast)
    density = np.array([heavier, (even.mass_kg - heavier * volume[0]) / volume[1]])
    body = replace(even, density=density)
    modal = modes_of(body, YOUNG, finer=0.85, count=12)
    seen = tracks(modal, motion(modal, YOUNG, gust()))
    told = "density_kg_m3" in scene
    return start_values(body if told else even, seen, PERIOD_S, settings(at_rest=True, **({"density_kg_m3": None} | scene | ({"density_kg_m3": density.tolist()} if told else {}))))[0]


@pytest.fixture(scope="module")
def uneven() -> StartValues:
    """Parts whose densities differ by one standard deviation of what is believed; only the mass is told."""
    across = np.array([2.0, -1.0]) / np.sqrt(5.0)  # of volumes 1 and 2, in ln(density) where the mass stays
    return started(DENSITY_CONTRAST * across[0])


def test_densities_one_deviation_off_shift_stiffness_by_about_one_stated_deviation(uneven: StartValues) -> None:
    shift = np.log10(uneven.young / YOUNG) / uneven.log10_young_sd
    assert 0.6 < abs(shift[0]) < 1.6
    assert np.abs(shift).max() < 2


def test_densities_that_are_told_leave_no_such_doubt(uneven: StartValues) -> None:
    told = started(0.3, density_kg_m3=None)
    assert np.abs(np.log10(told.young / YOUNG)).max() < 0.02
    assert (told.log10_young_sd < 0.5 * uneven.log10_young_sd).all()


def test_without_a_free_tail_the_densities_still_count() -> None:
    body, modal = bar(), modes_of(bar(), YOUNG)
    pushed = gust()
    pushed[:] = pushed.max(0) * (1 + 0.3 * np.sin(np.arange(len(pushed)))[:, None])
    seen = tracks(modal, motion(modal, YOUNG, pushed))
    told, untold = (start_values(body, seen, PERIOD_S, settings(at_rest=True, density_kg_m3=given))[0] for given in (body.density.tolist(), None))
    assert not untold.has_free_tail
    assert (untold.geometry_sd > 2 * told.geometry_sd).all()


def test_mode_frequencies_change_with_material_as_the_derivatives_say() -> None:
    """Against finite elements assembled once more, whose shapes are free to change too."""
    body, modal, count = bar(), modes_of(bar(), YOUNG), 3
    tail = SimpleNamespace(modal=modal, most_modes=count)
    by_density, by_poisson = mode_changes(tail, Physics(YOUNG, Damping(0.0, 0.0), np.zeros(0)), body)
    for part in range(body.parts):
        step = 0.01 * (np.arange(body.parts) == part)
        for found, (up, down) in (
            (by_density[:, part], [replace(body, density=body.density * np.exp(sign * step)) for sign in (1, -1)]),
            (by_poisson[:, part], [replace(body, poisson=body.poisson + sign * step) for sign in (1, -1)]),
        ):
            change = [np.log(squares(each, count)) for each in (up, down)]
            np.testing.assert_allclose(found, (change[0] - change[1]) / 0.02, atol=0.01)


def squares(body: Body, count: int) -> np.ndarray:
    elements = Elements.of(body)
    stiffness = elements.elastic(YOUNG)
    return elements.eigenmodes(stiffness, elements.factor(stiffness), count)[0]


def test_a_ratio_that_nobody_told_is_doubted_and_one_that_is_told_is_not(uneven: StartValues) -> None:
    told = started(0.0, density_kg_m3=None, poisson_ratio=[0.3])
    assert (told.material.poisson_sd == 0).all()
    assert (told.material.of_young == 0).all()
    assert (uneven.material.poisson_sd > 0.8 * POISSON_SD).all()
    assert (uneven.material.poisson_sd <= POISSON_SD).all()


def test_stiffness_over_density_of_the_outer_part_is_surer_than_stiffness(uneven: StartValues) -> None:
    """It swings on its own weight; that of the part at the clamp carries the other's."""
    assert uneven.material.of_specific[1] < 0.5 * uneven.material.of_young[1]
