"""The clock stops a run and plans nothing; a run that cannot simulate still ends with the best there is."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.config import build, flat
from diffphys_ros.inverse import Clock, clock_of, solve
from diffphys_ros.inverse.clock import FIT_END, OutOfTimeError
from diffphys_ros.resimulate import simulate_again

from .conftest import YOUNG
from .test_solve import drive


def stopped_after(prepared, settings, iterations):
    """The solver, whose clock runs out after so many iterations."""
    clock = Clock(1e6)
    steps, news = solve(prepared, None, settings, clock=clock), []
    while True:
        try:
            news.append(next(steps))
        except StopIteration as stop:
            return news, stop.value
        if news[-1].stage == "fit" and news[-1].iteration == iterations:
            clock.limit_s = 0.0


@pytest.fixture(scope="module")
def settings(quick_settings):
    return build(flat(quick_settings) | {"fit.iterations": 6})


def test_the_best_answer_so_far_is_kept_when_time_is_over(prepared, settings):
    _, stopped = stopped_after(prepared, settings, 2)
    _, short = drive(solve(prepared, None, build(flat(settings) | {"fit.iterations": 2})))
    assert stopped.metrics["stopped_by_budget"] is True
    assert stopped.metrics["iterations"] == 2
    assert stopped.notes[-1] == "stopped by the time budget of 0 s after 2 of 6 iterations; the best answer so far is kept"
    np.testing.assert_array_equal(stopped.trajectory, short.trajectory)
    np.testing.assert_array_equal(stopped.young, short.young)
    assert short.metrics["stopped_by_budget"] is False
    assert not any("stopped" in note for note in short.notes)


def test_a_clock_that_has_run_out_leaves_the_start_values(prepared, settings):
    news, recovery = drive(solve(prepared, None, settings, clock=Clock(1e-9)))
    assert (recovery.metrics["refined"], recovery.metrics["stopped_by_budget"], recovery.metrics["iterations"]) == (False, True, 0)
    assert recovery.metrics["not_simulated"].startswith("stopped by the time budget")
    np.testing.assert_array_equal(np.unique(recovery.young), np.sort(YOUNG))
    np.testing.assert_allclose(recovery.metrics["track_rms_m"], 0, atol=1e-4)
    assert any("the best answer so far is kept" in n.text for n in news)


def test_the_plan_is_the_same_however_little_time_is_left(prepared, settings):
    plans = [next(n.text for n in drive(solve(prepared, None, settings, clock=clock))[0] if n.stage == "plan" and ";" in n.text) for clock in (Clock(1e-9), Clock())]
    assert plans[0] == plans[1]


def test_a_simulation_is_ended_between_two_frames():
    clock = Clock(1e6)
    clock.check(0.5)
    clock.limit_s = 1e-9
    with pytest.raises(OutOfTimeError):
        clock.check(0.5)


def test_runs_side_by_side_have_as_many_times_the_time_and_told_iterations_all_of_it():
    alone, twelve = (clock_of(build({"fit.device": "cpu"}), side_by_side=n).limit_s for n in (1, 12))
    assert (alone, twelve) == (900.0, 12 * 900.0)
    assert clock_of(build({"fit.iterations": 3})).limit_s == np.inf
    assert Clock(100.0).allows_fit(100 * FIT_END - 1)
    assert not Clock(100.0).allows_fit(100 * FIT_END + 1)


def not_simulated(recovery, prepared, said):
    """Checks an answer of the start values alone."""
    assert (recovery.metrics["refined"], recovery.simulation.engine) == (False, "modes")
    assert said in recovery.metrics["not_simulated"]
    assert sum(said in note for note in recovery.notes) == 1
    for part, young in enumerate(prepared.start.young, 1):
        np.testing.assert_array_equal(recovery.young[recovery.part == part], young)


def test_a_clip_too_dear_for_every_grid_keeps_the_modes_answer_and_its_motion(prepared, tmp_path):
    settings = build({"scene.at_rest": True, "experiment.max_substeps": 4})
    news, recovery = drive(solve(prepared, None, settings))
    not_simulated(recovery, prepared, "4 are the most")
    assert not any(n.stage == "fit" for n in news)
    assert recovery.metrics["track_rms_m"] < prepared.tracks.noise_m
    result.save(recovery, prepared.clip, settings, tmp_path)
    np.testing.assert_array_equal(simulate_again(result.load(tmp_path)), recovery.trajectory)


def test_a_stiffness_that_no_substep_carries_ends_in_an_answer(prepared):
    absurd = dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, young=1e9 * YOUNG))
    _, recovery = drive(solve(absurd, None, build({"scene.at_rest": True})))
    not_simulated(recovery, absurd, "substeps a frame at E = 2e+14 Pa")


def test_a_foil_that_no_grid_carries_is_shown_by_few_particles(prepared):
    """A tenth of a millimetre thick, 0.3 by 0.1 m: cells of its thickness would be millions."""
    body = dataclasses.replace(prepared.body, half_thickness=np.full(prepared.body.inside.shape, 5e-5))
    _, recovery = drive(solve(dataclasses.replace(prepared, body=body), None, build({"scene.at_rest": True})))
    not_simulated(recovery, prepared, "substeps a frame")
    assert 1000 < len(recovery.points) < 6000
    assert recovery.volume.sum() == pytest.approx(body.volume_m3, rel=1e-6)


def test_a_force_that_no_simulation_follows_ends_in_the_start_values(prepared, quick_settings):
    torn = dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, force=1e5 * prepared.start.force))
    news, recovery = drive(solve(torn, None, quick_settings))
    not_simulated(recovery, torn, "not simulated: ")
    assert any("the start values are the answer" in (n.text or "") for n in news)
