"""What is said of stiffness and force, by what the recording and the answer leave open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.inverse.posterior import Confidence, Explained, of_answer
from diffphys_ros.inverse.unknowns import Layout
from diffphys_ros.types import Doubt

SIZE_M = 0.01
GAP, CAMERA = Doubt("frames are missing", of_young=False), Doubt("the camera moves", of_young=True)


def said(prepared, *, missed_m: float = 1e-4, simulated: bool = True, grid_log10_sd: float = 0.005, moved: float = 0.0) -> Confidence:
    layout = Layout.of(prepared.start, prepared.body, force_unit=1.0, initial_modes=0, motion_unit=np.ones((2, prepared.modal.modes)), held=())
    explained = Explained(missed_m / np.sqrt(3), SIZE_M, grid_log10_sd, np.array([moved, 0.0]), np.eye(layout.size))
    return of_answer(prepared, layout, explained, simulated=simulated)


@pytest.mark.parametrize("simulated", [True, False])
def test_an_answer_that_follows_the_motion_of_a_sound_clip_knows_its_force_and_says_how_well(prepared, simulated):
    found = said(prepared, simulated=simulated)
    assert found.identified.all()
    assert found.force_identified
    assert found.force_reason == "the answer misses 0.10 mm of a motion of 10.00 mm, where the tracks' noise is 0.10 mm."


@pytest.mark.parametrize("simulated", [True, False])
def test_an_answer_that_misses_much_of_the_motion_knows_no_force(prepared, simulated):
    found = said(prepared, missed_m=0.2 * SIZE_M, simulated=simulated)
    assert not found.force_identified
    assert "misses 2.00 mm" in found.force_reason


def test_a_simulated_stiffness_is_as_much_less_sure_as_its_own_grid_is_off(prepared):
    start = prepared.start.log10_young_sd
    np.testing.assert_allclose(said(prepared, grid_log10_sd=0.03).log10_young_sd, np.hypot(start, 0.03))
    np.testing.assert_allclose(said(prepared, grid_log10_sd=0.03, simulated=False).log10_young_sd, start)


def test_where_the_engines_differ_a_simulated_stiffness_is_as_much_less_sure(prepared):
    start = prepared.start.log10_young_sd
    found = said(prepared, grid_log10_sd=0.0, moved=-0.08)
    np.testing.assert_allclose(found.log10_young_sd, np.hypot(start, [0.08, 0.0]))
    assert found.identified.all()
    apart = said(prepared, moved=-0.5)
    assert apart.identified.tolist() == [False, True]
    assert "the simulation makes 0.32 times as much" in apart.reasons[0]


def test_a_border_that_may_hide_makes_a_simulated_stiffness_as_unsure_where_the_modes_miss_the_motion(prepared):
    start = replace(prepared.start, modes_hold=False, has_free_tail=True, geometry_sd=np.array([0.27, 0.0]))
    body = replace(prepared.body, sources=prepared.body.sources | {"parts": "stiffness may change where nothing can be seen"})
    found = said(replace(prepared, start=start, body=body))
    assert found.log10_young_sd[0] > 0.27
    assert not found.identified[0]
    assert "stiffness may change where nothing can be seen" in found.reasons[0]
    assert "stiffness may change" not in found.reasons[1]


def test_a_simulation_without_a_free_tail_is_no_surer_than_modes_under_a_free_force(prepared):
    start = replace(prepared.start, has_free_tail=False, log10_young_sd=np.array([0.25, 0.4]))
    found = said(replace(prepared, start=start))
    assert (found.log10_young_sd >= start.log10_young_sd).all()
    assert found.identified.tolist() == [True, False]


def test_a_misfit_within_the_noise_is_forgiven_however_small_the_motion(prepared):
    noisy = replace(prepared, tracks=replace(prepared.tracks, noise_m=5e-4))
    assert said(noisy, missed_m=0.2 * SIZE_M).force_identified


def test_a_gap_in_the_clip_takes_the_force_and_leaves_the_stiffness(prepared):
    found = said(replace(prepared, doubts=(GAP,)))
    assert found.identified.all()
    assert (found.force_identified, found.force_reason) == (False, "frames are missing.")


def test_of_a_motion_that_is_not_that_of_the_film_it_is_said_though_the_force_is_doubted_anyway(prepared):
    """As of a block that bounces higher than its simulation: its trajectory is no measurement."""
    found = said(replace(prepared, doubts=(GAP,)), missed_m=2 * SIZE_M)
    assert found.identified.all()
    assert found.force_reason.startswith("frames are missing. ")
    assert "misses 20.00 mm of a motion of 10.00 mm" in found.force_reason


def test_a_moving_camera_takes_both(prepared):
    found = said(replace(prepared, start=replace(prepared.start, young_lower=np.array([np.nan, 1e4])), doubts=(CAMERA,)))
    assert not found.identified.any()
    assert np.isnan(found.young_lower).all()
    assert set(found.reasons) == {"the camera moves."}
    assert (found.log10_young_sd >= 0.5).all()
    assert not found.force_identified


def test_without_any_stiffness_there_is_no_force(prepared):
    start = replace(prepared.start, identified=np.zeros(2, bool), reasons=("it hardly moves.",) * 2)
    found = said(replace(prepared, start=start))
    assert not found.force_identified
    assert "it hardly moves." in found.force_reason


def test_a_part_that_hardly_strains_takes_no_force_from_the_other(prepared):
    start = replace(prepared.start, identified=np.array([True, False]))
    assert said(replace(prepared, start=start)).force_identified
