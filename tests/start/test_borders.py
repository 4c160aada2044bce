"""Materials that look alike, told apart by stiffness: bars whose stiffness along the body is known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.start import start_values
from diffphys_ros.start.borders import ZONE_SD, Cut, Parted, Scan, Tried, Zones, cuts_of, parted_by_stiffness
from diffphys_ros.start.evidence import Evidence
from diffphys_ros.start.free_tail import RATIO_SD, Physics
from diffphys_ros.start.zone_layout import Division
from diffphys_ros.types import Body
from diffphys_ros.vibration.coordinates import observe
from tests.made_bar import PERIOD_S, bar, gust, modes_of, motion, settings, tracks

SIZE = {"length": 0.3, "height": 0.04, "thickness": 0.05, "pitch": 1e-3}
BORDER = 0.13  # m
STIFF, SOFT = 8e5, 2e5  # Pa


@cache
def found(edges: tuple[float, ...], young: tuple[float, ...], *, draws: bool = True) -> Parted | None:
    """What a bar that is taken for one part is parted into, by noisy tracks of a bar with parts."""
    true = bar(edges=edges, **SIZE)
    modes = modes_of(true, np.array(young), finer=0.85, count=12)
    seen = tracks(modes, motion(modes, np.array(young), gust(peak=1500.0)), seed=0)
    body, words = bar(edges=(), **SIZE), settings(at_rest=True, density_kg_m3=[600.0])
    start, modal = start_values(body, seen, PERIOD_S, words)
    return parted_by_stiffness(body, seen, PERIOD_S, words, start, modal, draws=draws)


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
    inner, outer = STIFF, 6.2e5
    parted = found((BORDER,), (inner, outer))
    assert parted is not None
    assert parted.body.parts == 1
    sd = parted.start.log10_young_sd
    assert 0.03 < sd[0] < 0.12
    assert parted.start.geometry_sd == pytest.approx(sd, rel=0.05)
    assert (np.abs(np.log10(parted.start.young / (inner, outer))) < 2 * sd).all()
    assert "one more border would explain the free motion better" in parted.start.reasons[0]
    assert "one more border would explain the free motion better" in parted.body.sources["parts"]


@pytest.mark.slow
def test_a_border_is_not_drawn_where_a_joint_fit_found_what_is_free_but_no_modulus_is_told_either():
    parted = found((BORDER,), (STIFF, SOFT), draws=False)
    assert parted.body.parts == 1
    assert parted.start.has_free_tail
    assert not parted.start.identified.any()
    assert "one more border would explain the free motion better" in parted.start.reasons[0]


def zones_of(true: Body) -> Zones:
    """Of a bar of one material that nothing pulls, by tracks of a true one."""
    modes = modes_of(true, np.array([STIFF]), count=12)
    seen = tracks(modes, motion(modes, np.array([STIFF]), gust(peak=1500.0)), seed=0)
    body, words = bar(edges=(), **SIZE), settings(at_rest=True, density_kg_m3=[600.0])
    start, _ = start_values(body, seen, PERIOD_S, words)
    return Zones.of(Evidence(body, seen, observe(body, seen, None), PERIOD_S, words), start, weighed=False)


def test_a_zone_that_is_as_soft_or_stiff_as_outline_and_thickness_make_it_is_no_sign_of_a_border() -> None:
    zones = zones_of(bar(edges=(), **SIZE))
    fit, every = zones.fitted(), np.arange(zones.division.count)
    off = ZONE_SD * zones.tail(every).slope(replace(fit.physics, young=fit.physics.young[every * 0]))[:, every]
    assert np.linalg.norm(off, axis=0).max() > 3.0
    assert np.linalg.norm(zones.errors(fit).whitened(off), axis=0).max() < 1.0


def test_frequencies_that_contradict_each_other_count_the_less() -> None:
    assert zones_of(bar(edges=(), **SIZE)).scan().scale == pytest.approx(1.0, abs=0.1)
    assert zones_of(bar(edges=(), gravity=(9.81, 0.0, 0.0), **SIZE)).scan().scale > 1.5  # it hangs, and its first frequency is higher for it


def tee() -> Division:
    """Two zones of a stem, 0 and 1, and an arm, 2 and 3, of the same part; a zone of another part, 4, at the stem's end."""
    return Division(np.zeros((1, 1), np.uint8), np.array([1, 1, 1, 1, 2]), np.array([0.1, 0.3, 0.4, 0.6, 0.7]), np.array([[0, 1], [1, 2], [2, 3], [1, 4]]))


def test_a_cut_divides_one_part_and_leaves_the_others_whole():
    labels = {tuple(cut.label.tolist()) for cut in cuts_of(tee())}
    assert labels == {(0, 1, 1, 1, 2), (0, 0, 1, 1, 2), (0, 0, 0, 1, 2)}


TOLD = 1e8  # curvature by what the motion tells, per ln E squared


def scan(*falls: float, contrast: float = TOLD, ratio: float = 3.0, scale: float = 1.0) -> Scan:
    """A bar of two zones, and fits with one cut whose outer modulus is so many times the inner one, each with so much less misfit than without it; `contrast` is
    how the misfit bends with the outer modulus."""
    division = Division(np.zeros((1, 1), np.uint8), np.ones(2, int), np.array([0.25, 0.75]), np.array([[0, 1]]))
    cut, none = next(cuts_of(division)), Damping(0.0, 0.0)
    uncut = Tried(Cut(np.zeros(2, int), 0, 0, 0.0), 100.0, Physics(np.array([1e5]), none, np.zeros(0)), np.diag([TOLD]))
    outer = Physics(1e5 * np.array([1.0, ratio]), none, np.zeros(0))
    return Scan(np.ones(2), uncut, [Tried(cut, 100.0 - fall, outer, np.diag([TOLD, contrast])) for fall in falls], scale)


def test_a_border_is_as_likely_as_its_misfit_is_less_but_for_what_its_freedom_buys() -> None:
    spent = 0.5 * np.log(TOLD * RATIO_SD**2)
    assert scan(30.0).evidence == pytest.approx(15.0 - spent)
    assert scan(30.0, scale=2.0).evidence == pytest.approx(7.5 - spent)  # where all misfits are twice as large as they should be
    assert scan(30.0, 30.0, -1000.0).evidence == pytest.approx(15.0 - spent + np.log(2 / 3))  # nobody knows where it lies
    assert scan(30.0, contrast=TOLD / 100).evidence > scan(30.0).evidence  # a modulus that many values explain needs less luck
    assert scan().evidence == -np.inf


def test_what_the_modes_miss_for_other_reasons_raises_no_doubt() -> None:
    likely = scan(35.0)
    assert 5.0 < likely.evidence < 10.0
    assert likely.doubtful
    assert not replace(likely, left=2.5).doubtful
    assert not scan(25.0).doubtful


def test_a_border_that_the_misfit_does_not_ask_for_makes_the_modulus_less_sure_the_likelier_it_is():
    open_ = {"contrast": RATIO_SD**-2}  # the motion tells no more than is believed
    same, likelier, refused = (scan(fall, **open_).further_variance()[0] for fall in (0.0, 10.0, -100.0))
    assert same == pytest.approx(0.5 * 0.5 * (np.log(3.0) ** 2 + RATIO_SD**2))  # as likely as none, in half of the volume
    assert likelier == pytest.approx(2 * same, rel=0.01)
    assert refused < 0.1 * same
    assert scan(4000.0, **open_).further_variance()[0] == pytest.approx(2 * same)  # what is beyond doubt overflows nothing
