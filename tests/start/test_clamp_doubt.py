"""What a clamp that is known to a few pixels only leaves open of stiffness, on bars that are held elsewhere than they are said to be."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from diffphys_ros.start import start_values
from diffphys_ros.types import StartValues
from tests.made_bar import LENGTH, PERIOD_S, YOUNG, bar, gust, modes_of, motion, settings, tracks

OFF_M = 0.006  # of the held face from where it is said to be, and its standard deviation


@cache
def started(parts: int, sd_m: float, *, mass: bool = False, freely: bool = True) -> StartValues:
    """Of a bar said to begin OFF_M further out than it does; mass: that is told, not the density; freely: the force ends."""
    edges, young = ((LENGTH / 3,), YOUNG) if parts == 2 else ((), YOUNG[:1])
    held, force = bar(edges=edges), gust()
    if not freely:
        force[:] = force.max(0) * (1 + 0.3 * np.sin(np.arange(len(force)))[:, None])
    modal = modes_of(held, young)
    seen = tracks(modal, motion(modal, young, force))
    said = replace(bar(length=LENGTH - OFF_M, edges=tuple(edge - OFF_M for edge in edges)), clamp_sd_m=sd_m)
    weight = {"mass_kg": held.mass_kg, "density_kg_m3": None} if mass else {"density_kg_m3": said.density.tolist()}
    if mass:
        said = replace(said, density=held.density * LENGTH / (LENGTH - OFF_M))
    seen = replace(seen, points=seen.points - np.array([OFF_M, 0.0, 0.0]))
    return start_values(said, seen, PERIOD_S, settings(at_rest=True, poisson_ratio=[0.3], **weight))[0]


def share_of(doubted: StartValues, told: StartValues) -> np.ndarray:
    """What the clamp's place adds to the standard deviation of log10 E (n,)."""
    return np.sqrt(doubted.geometry_sd**2 - told.geometry_sd**2)


@pytest.mark.parametrize("parts", [1, 2])
def test_the_held_face_one_deviation_off_shifts_stiffness_by_about_what_is_said(parts: int) -> None:
    told, doubted = (started(parts, sd_m) for sd_m in (0.0, OFF_M))
    error = np.log10(doubted.young / YOUNG[:parts])
    share = share_of(doubted, told)
    assert abs(error[0]) > 0.02
    assert abs(error[0]) / share[0] == pytest.approx(1.0, abs=0.15)
    assert (np.abs(error) < 2 * doubted.log10_young_sd).all()
    assert f"leaves log10 E open by {share[0]:.3f}" in doubted.reasons[0]
    assert "held face" not in told.reasons[0]


def test_of_a_told_mass_a_longer_body_is_as_much_lighter() -> None:
    told, doubted = (started(1, sd_m, mass=True) for sd_m in (0.0, OFF_M))
    share = share_of(doubted, told)
    assert abs(np.log10(doubted.young / YOUNG[:1])) / share == pytest.approx(1.0, abs=0.15)
    assert share < 0.85 * share_of(started(1, OFF_M), started(1, 0.0))


def test_without_a_free_tail_the_place_of_the_clamp_still_counts() -> None:
    told, doubted = (started(1, sd_m, freely=False) for sd_m in (0.0, OFF_M))
    assert not doubted.has_free_tail
    assert share_of(doubted, told) == pytest.approx(share_of(started(1, OFF_M), started(1, 0.0)), rel=0.2)
