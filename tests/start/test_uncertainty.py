"""What densities that nobody told do to stiffness, on bars whose parts are heavier and lighter than assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.differences import differences
from diffphys_ros.start import start_values
from diffphys_ros.start.free_tail import physical
from diffphys_ros.start.uncertainty import DENSITY_CONTRAST
from diffphys_ros.types import StartValues
from tests.made_bar import PERIOD_S, YOUNG, bar, gust, modes_of, motion, settings, tracks


def started(contrast: float, **scene: object) -> StartValues:
    """Of a bar whose part at the clamp is heavier than the mean by a factor exp(contrast), of the same mass in all."""
    even = bar()
    volume, heavier = even.part_volumes_m3, even.density[0] * np.exp(contrast)
    density = np.array([heavier, (even.mass_kg - heavier * volume[0]) / volume[1]])
    body = replace(even, density=density)
    modal = modes_of(body, YOUNG, finer=0.85, count=12)
    seen = tracks(modal, motion(modal, YOUNG, gust()))
    told = "density_kg_m3" in scene
    return start_values(body if told else even, seen, PERIOD_S, settings(at_rest=True, **(scene | ({"density_kg_m3": density.tolist()} if told else {}))))[0]


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


def test_a_difference_is_taken_from_above_where_the_other_side_is_not_physical() -> None:
    def only_above(at: np.ndarray) -> np.ndarray:
        assert at.min() >= 0
        return at**2

    np.testing.assert_allclose(differences(only_above, np.array([0.0, 1.0]), least=0.0), np.diag([0.0, 2.0]), atol=2e-4)
    np.testing.assert_array_equal(np.isfinite(physical(5, 2)), [False, False, True, True, False])


def test_a_part_that_is_next_to_rigid_has_finite_derivatives_without_damping() -> None:
    rigid = np.array([YOUNG[0], 1e6 * YOUNG[1]])
    modal = modes_of(bar(), rigid, count=8)
    force = gust()
    words = {"footprint": modal.footprint_load(), "force": force, "frames": np.array([3]), "period_s": PERIOD_S}
    with np.errstate(over="raise"):
        found = modal.jacobian(rigid, damping=Damping(0.0, 0.0), **words)
    assert np.isfinite(found).all()
