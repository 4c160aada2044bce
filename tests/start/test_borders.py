"""Materials that look alike, told apart by stiffness: bars whose stiffness along the body is known."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.start import start_values
from diffphys_ros.start.borders import Cut, Parted, Scan, Tried, cuts_of, parted_by_stiffness
from diffphys_ros.start.free_tail import Physics
from diffphys_ros.start.zone_layout import Division
from tests.made_bar import PERIOD_S, bar, gust, modes_of, motion, settings, tracks

SIZE = {"length": 0.3, "height": 0.04, "thickness": 0.05, "pitch": 1e-3}
BORDER = 0.13  # m
STIFF, SOFT = 8e5, 2e5  # Pa


@cache
def found(edges: tuple[float, ...], young: tuple[float, ...]) -> Parted | None:
    """What a bar that is taken for one part is parted into, by noisy tracks of a bar with parts."""
    true = bar(edges=edges, **SIZE)
    modes = modes_of(true, np.array(young), finer=0.85, count=12)
    seen = tracks(modes, motion(modes, np.array(young), gust(peak=1500.0)), seed=0)
    body, words = bar(edges=(), **SIZE), settings(at_rest=True, density_kg_m3=[600.0])
    start, modal = start_values(body, seen, PERIOD_S, words)
    return parted_by_stiffness(body, seen, PERIOD_S, words, start, modal)


@pytest.mark.slow
def test_a_border_that_nobody_has_seen_is_found_with_the_stiffness_on_both_sides():
    parted = found((BORDER,), (STIFF, SOFT))
    body, start = parted.body, parted.start
    assert body.parts == 2
    off = np.log10(start.young / (STIFF, SOFT))
    assert np.abs(off).max() < 0.06
    assert (np.abs(off) < 2 * start.log10_young_sd).all()
    row = body.part[:, body.part.shape[1] // 2]
    assert abs((np.flatnonzero(row == 2)[0] * body.pitch_m + body.origin[0]) - BORDER) < 0.02


@pytest.mark.slow
def test_the_answer_says_that_stiffness_found_the_border_and_where():
    parted = found((BORDER,), (STIFF, SOFT))
    assert "by stiffness" in parted.body.sources["parts"]
    assert "of the way from the clamp" in parted.body.sources["parts"]
    assert all("stiffness" in reason for reason in parted.start.reasons)


@pytest.mark.slow
def test_a_bar_of_one_material_stays_one_part():
    assert found((), (STIFF,)) is None


@pytest.mark.slow
def test_a_border_that_is_neither_drawn_nor_ruled_out_leaves_one_part_whose_modulus_is_as_unsure_as_such_a_border_makes_it():
    parted = found((BORDER,), (STIFF, 6.5e5))
    assert parted is not None
    assert parted.body.parts == 1
    assert parted.start.log10_young_sd == pytest.approx(0.275, abs=0.02)
    assert parted.start.geometry_sd == pytest.approx(0.275, abs=0.02)
    assert not parted.start.identified.any()
    assert "one more border would lower the misfit" in parted.start.reasons[0]
    assert "one more border would lower the misfit" in parted.body.sources["parts"]


def tee() -> Division:
    """Two zones of a stem, 0 and 1, and an arm, 2 and 3, of the same part; a zone of another part, 4, at the stem's end."""
    return Division(np.zeros((1, 1), np.uint8), np.array([1, 1, 1, 1, 2]), np.array([0.1, 0.3, 0.4, 0.6, 0.7]), np.array([[0, 1], [1, 2], [2, 3], [1, 4]]))


def test_a_cut_divides_one_part_and_leaves_the_others_whole():
    labels = {tuple(cut.label.tolist()) for cut in cuts_of(tee())}
    assert labels == {(0, 1, 1, 1, 2), (0, 0, 1, 1, 2), (0, 0, 0, 1, 2)}


def scan(chi2: float, ratio: float, frames: int = 40) -> Scan:
    """A bar of two zones with one cut, whose outer modulus is so many times the inner one."""
    division = Division(np.zeros((1, 1), np.uint8), np.ones(2, int), np.array([0.25, 0.75]), np.array([[0, 1]]))
    cut = next(cuts_of(division))
    still = np.zeros(0)
    uncut = Tried(Cut(np.zeros(2, int), 0, 0, 0.0), 100.0, Physics(np.array([1e5]), Damping(0.0, 0.0), still), np.zeros(1), frames)
    tried = Tried(cut, chi2, Physics(1e5 * np.array([1.0, ratio]), Damping(0.0, 0.0), still), np.zeros(2), frames)
    return Scan(np.ones(2), uncut, [tried], np.array([0.9, 0.1]))


def test_a_border_that_the_misfit_does_not_ask_for_makes_the_modulus_less_sure_the_likelier_it_is():
    same, likelier, refused = (scan(chi2, 3.0).further_variance()[0] for chi2 in (100.0, 90.0, 200.0))
    assert same == pytest.approx(0.5 * 0.5 * np.log(3.0) ** 2)  # as likely as none, in half of the volume
    assert likelier > same
    assert refused < 0.1 * same


def test_a_border_is_not_ruled_out_where_it_explains_the_motion_by_much_better_or_where_nothing_is_told_beyond_another():
    sure, open_beyond = (SimpleNamespace(log10_young_sd=np.array(sd)) for sd in ([0.1, 0.3], [0.1, 1.4]))
    assert "by 43% of what is left" in scan(70.0, 3.0).doubt(sure)
    assert not scan(80.0, 3.0).doubt(sure)
    assert not scan(70.0, 3.0, frames=10).doubt(sure)  # the border leaves more than such frames may miss
    assert "beyond the border that was found" in scan(80.0, 3.0).doubt(open_beyond)


def test_a_border_that_may_hide_moves_the_outer_zone_by_its_contrast_less_what_the_frequency_takes_back():
    contrast = 0.5 * np.log(10.0)
    assert scan(90.0, 3.0).hidden_variance()[0] == pytest.approx(contrast**2 * (0.1**2 + 0.9**2) / 2)


def test_a_misfit_below_what_is_expected_counts_as_no_fall():
    assert scan(60.0, 3.0).fall == pytest.approx(40.0 / 60.0)
    assert scan(10.0, 3.0).fall == pytest.approx(90.0 / 40.0)
