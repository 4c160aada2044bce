"""What neither modes nor a simulated force explain is carried by fields, and an answer is never worse than standing still."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diffphys_ros import inverse
from diffphys_ros.config import LONGEST_BUDGET_S, TIME_BUDGET_S, build, layered
from diffphys_ros.errors import InputError, SimulationError
from diffphys_ros.inverse import clock_of, explaining, prepare, solve
from diffphys_ros.inverse.choice import STILL, of_still
from diffphys_ros.inverse.clock import FIT_END, SLICED, Clock
from diffphys_ros.inverse.explaining import CARRIED, EXPLAINING, UNKNOWN, carried_by_fields, lengthened, may_carry, modes_miss, shortened
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.prepared import Prepared
from diffphys_ros.inverse.problem import Problem
from diffphys_ros.inverse.stages import schedule
from diffphys_ros.inverse.transitions import Walk
from diffphys_ros.types import Recovery
from tests.boxes import bar, bar_settings, box_clip, oblique_camera, turned

from .test_paper import FILE, filmed, problem, speckled  # noqa: F401 fixtures
from .test_solve import drive

LINEAR = {"experiment.schedule": "linear", "experiment.force_frame": "rest", "fit.hold": ["force", "damping", "motion", "density", "poisson"], "scene.at_rest": True}


def test_the_fields_are_those_of_the_published_schedule() -> None:
    published, ours = layered([FILE], {}), explaining.explaining(build({}))
    assert {name: getattr(published.experiment, name) for name in EXPLAINING} == dict(EXPLAINING)
    assert (ours.fit.hold, ours.fit.material_field, ours.fit.force_field) == (published.fit.hold, published.fit.material_field, published.fit.force_field)
    assert ours.prior.materials == published.prior.materials == [UNKNOWN]


@pytest.mark.parametrize("asked", [{"fit.iterations": 3}, {"fit.hold": ["young"]}, {"experiment.schedule": "modes"}, {"fit.force_field": "modes"}])
def test_nothing_takes_the_place_of_a_fit_that_was_asked_for(prepared: Prepared, asked: dict[str, object]) -> None:
    assert may_carry(prepared, build({}))
    assert not may_carry(prepared, build(asked))


def test_what_bounces_on_a_floor_is_not_carried_by_fields(prepared: Prepared) -> None:
    above = build({"scene.floor_z_m": -1.0})
    assert may_carry(prepared, above), "a clamp holds it"
    assert not may_carry(replace(prepared, body=replace(prepared.body, clamped=False)), above)


def test_time_is_left_for_fields_where_modes_miss_the_motion_and_tell_no_stiffness(prepared: Prepared) -> None:
    start = replace(prepared.start, track_cost=0.25, identified=np.zeros(2, bool))
    assert modes_miss(replace(prepared, start=start))
    assert not modes_miss(replace(prepared, start=replace(start, track_cost=1e-4)))
    assert not modes_miss(replace(prepared, start=replace(start, identified=np.ones(2, bool))))
    settings, clock = shortened(build({"fit.time_budget_s": 100.0}), Clock(100.0))
    assert settings.fit.time_budget_s == clock.limit_s == 50.0
    assert shortened(build({}), Clock())[1].limit_s == np.inf


@pytest.fixture
def on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans and clocks as if the machine had one."""
    for module in (inverse, explaining):
        monkeypatch.setattr(module, "usable", lambda word: "cuda:0")


@pytest.mark.usefixtures("on_a_gpu")
def test_on_a_gpu_fields_have_what_450_s_told_by_a_person_give_them_and_nothing_told_is_changed() -> None:
    untold, told = ((build(given), clock_of(build(given))) for given in ({}, {"fit.time_budget_s": 450.0}))
    assert untold[1].limit_s == TIME_BUDGET_S["cuda"]
    longer = lengthened(*untold)
    assert (longer[0], longer[1].limit_s) == (told[0], told[1].limit_s) == (told[0], LONGEST_BUDGET_S["cuda"])
    assert longer[1].spent_s > told[1].spent_s  # it went on
    assert lengthened(*longer) == longer
    for given in ({"fit.time_budget_s": 60.0}, {"fit.iterations": 3}):
        settings, clock = build(given), clock_of(build(given))
        assert lengthened(settings, clock) == (settings, clock)
    mine = Clock(30.0)
    assert lengthened(build({}), mine) == (build({}), mine)


@pytest.mark.usefixtures("on_a_gpu")
@pytest.mark.parametrize("given", [{}, {"fit.time_budget_s": 60.0}])
def test_three_clips_side_by_side_have_the_plan_of_one_and_three_times_its_time(given: dict[str, object]) -> None:
    settings = build(given)
    alone, three = (shortened(*lengthened(settings, clock_of(settings, side_by_side=n))) for n in (1, 3))
    assert alone[0] == three[0]
    assert three[1].limit_s == pytest.approx(3 * alone[1].limit_s)


def test_on_a_cpu_nothing_is_longer() -> None:
    settings = build({"fit.device": "cpu"})
    clock = clock_of(settings)
    assert lengthened(settings, clock) == (settings, clock)
    assert clock.limit_s == LONGEST_BUDGET_S["cpu"] == TIME_BUDGET_S["cpu"]


@pytest.mark.usefixtures("on_a_gpu")
@pytest.mark.parametrize(("missed", "unexplained", "limits"), [(False, False, [120, 120, 120]), (True, False, [225, 450, 450]), (False, True, [120, 450, 450, 450]), (True, True, [225, 450, 450, 450])])
def test_a_clip_that_modes_explain_keeps_its_time_and_what_fields_may_carry_has_more(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch, missed: bool, unexplained: bool, limits: list[float]
) -> None:
    heard = []

    def step(answer, clock_of_call):
        def told(*args, **words):
            yield from ()
            settings, clock = clock_of_call(args, words)
            heard.append((settings.fit.time_budget_s or TIME_BUDGET_S["cuda"], clock.limit_s))
            return answer

        return told

    named = lambda args, words: (next(a for a in args if hasattr(a, "fit")), words["clock"])  # noqa: E731
    monkeypatch.setattr(inverse, "modes_miss", lambda _: missed)
    monkeypatch.setattr(inverse, "calls_for_fields", lambda *_: unexplained)
    monkeypatch.setattr(inverse, "solve", step(None, named))
    monkeypatch.setattr(inverse, "carried_by_fields", step((prepared, None, None, None), lambda args, _: args[-2:]))
    monkeypatch.setattr(inverse, "uncover", step((None, None, None), named))
    monkeypatch.setattr(inverse, "refine_gaussians", step((None, None), named))
    judge = SimpleNamespace(judged=lambda recovery, _: recovery)
    drive(inverse._solved(prepared, build({}), judge, speckled(), None, clock_of(build({}))))  # type: ignore[arg-type]
    assert [limit for _, limit in heard] == pytest.approx(limits)
    assert [budget for budget, _ in heard] == pytest.approx(limits)  # plans are for the same


def test_what_is_left_of_the_time_is_dealt_out_to_the_frames(problem: Problem) -> None:  # noqa: F811
    clock = Clock(100.0)
    assert clock.slice_end_s(4) == pytest.approx(0.9 * FIT_END * 100 / 4, rel=0.01)
    model, counts = Model(problem), []
    model.enter(schedule(problem)[0])
    for limit in (np.inf, 1e-9):
        walk, count = Walk(model, Clock(limit)), [0]
        loss = walk._loss

        def counted(*args, loss=loss, count=count):
            count[0] += 1
            return loss(*args)

        walk._loss = counted  # type: ignore[method-assign]
        walk.seek(2)
        counts.append(count[0])
    assert counts[1] < counts[0] / 2


class _Set(Clock):
    """Shows the time that it is set to."""

    spent_s = 0.0  # type: ignore[assignment]


def test_the_first_force_which_begins_from_none_is_sought_six_times_as_long_as_another(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    model, clock, ends = Model(problem), _Set(100.0), []
    model.enter(schedule(problem)[0])
    walk = Walk(model, clock)
    monkeypatch.setattr(walk, "_lower", lambda sought, frame, block_px, iterations, end_s: ends.append(end_s - clock.spent_s) or 0.0)
    for frame in (0, 1, 2):
        walk.seek(frame)
        clock.spent_s += ends[-1] / SLICED  # type: ignore[misc]
    first, second, third = ends[1::2]  # of which the coarse part ends earlier
    assert first == pytest.approx(6 * second)
    assert second == pytest.approx(third)


@pytest.fixture(scope="module")
def wrong(filmed: Prepared) -> Recovery:  # noqa: F811
    """What a force that pushes the wrong way makes of the clip, by modes."""
    start = replace(filmed.start, force=-2 * filmed.start.force, identified=np.zeros(2, bool))
    settings = build(LINEAR | {"experiment.cells": 3, "experiment.per_cell": 1.0})
    return drive(solve(replace(filmed, start=start), speckled(), settings))[1]


def test_an_answer_that_shows_the_clip_worse_than_its_first_frame_stands_still(wrong: Recovery) -> None:
    assert STILL in wrong.notes
    assert not wrong.force.any()
    np.testing.assert_array_equal(wrong.trajectory, np.repeat(wrong.trajectory[:1], len(wrong.trajectory), 0))
    assert not wrong.identified.any()


def test_an_answer_that_stands_still_tells_nothing_of_the_fields_that_it_takes_the_place_of() -> None:
    fields = {"fields": {"field_force_rms_n_m3": 4000.0}, "refined": True, "misfit": 0.1, "substeps": 16}
    still = SimpleNamespace(misfit=0.2, track_rms_m=1e-3)
    assert of_still(fields, still) == {"refined": False, "misfit": 0.2, "track_rms_m": 1e-3, "substeps": 16}


@pytest.mark.parametrize(("psnr", "better"), [(60.0, True), (1.0, False)])
def test_fields_take_over_where_they_show_the_clip_better_and_say_that_they_measure_nothing(
    filmed: Prepared, wrong: Recovery, monkeypatch: pytest.MonkeyPatch, psnr: float, better: bool  # noqa: F811
) -> None:
    found = replace(wrong, metrics=wrong.metrics | {"psnr_masked": psnr}, reasons=("published",) * len(wrong.reasons), force_reason="published")

    def by_fields(prepared, asked, clock):
        yield from ()
        return prepared, speckled(), found, np.zeros((120, 160, 3), np.uint8)

    monkeypatch.setattr(explaining, "_by_fields", by_fields)
    behind = np.ones((120, 160, 3), np.uint8)
    *_, answer, scene = drive(carried_by_fields(filmed, speckled(), wrong, behind, build({}), Clock()))[1]
    assert (answer is wrong) != better
    assert (scene is behind) != better
    if better:
        assert answer.reasons == wrong.reasons
        assert answer.force_reason == CARRIED
        assert any(CARRIED in note for note in answer.notes)
        assert answer.metrics["psnr_masked_without_fields"] == wrong.metrics["psnr_masked"]
        assert not answer.identified.any()


def test_fields_that_the_clock_stopped_leave_a_note(filmed: Prepared, wrong: Recovery, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    def by_fields(prepared, asked, clock):
        yield from ()
        return prepared, speckled(), replace(wrong, metrics=wrong.metrics | {"stopped_by_budget": True, "psnr_masked": 0.0}), None

    monkeypatch.setattr(explaining, "_by_fields", by_fields)
    *_, kept, _ = drive(carried_by_fields(filmed, speckled(), wrong, np.ones((120, 160, 3), np.uint8), build({}), Clock(1e6)))[1]
    assert kept.notes[:-1] == wrong.notes
    assert "raise fit.time_budget_s" in kept.notes[-1]


@pytest.mark.slow
def test_fields_are_sought_on_a_thin_sheet_of_the_same_clip(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = box_clip(bar(), [turned(0.05 * np.sin(0.9 * k)) for k in range(8)], oblique_camera())
    settings = bar_settings(scene__thickness_m=None, fit__device="cpu", experiment__max_splats=200, experiment__splat_iterations=4, experiment__field_iterations=1)
    prepared = drive(prepare(clip, settings))[1]
    monkeypatch.setattr(explaining, "EXPLAINING", {**EXPLAINING, "transition_iterations": 1, "grid_nodes": 24, "force_voxels": 4})
    again, splats, recovery, behind = drive(explaining._by_fields(prepared, explaining.explaining(settings), Clock()))[1]
    assert "thin sheet" in again.body.sources["thickness"]
    assert again.body.volume_m3 < 0.5 * prepared.body.volume_m3
    assert recovery.simulation.engine == "mpm"
    assert np.abs(recovery.force).max() > 0
    assert not recovery.identified.any()
    assert behind.shape == clip.frames.shape[1:]
    assert len(splats.mean) <= 200


@pytest.mark.parametrize("error", [InputError("no such grid"), SimulationError("frame 7: the material turned inside out")])
def test_without_time_or_a_simulation_the_answer_stays_and_says_so(filmed: Prepared, wrong: Recovery, error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: F811
    behind = np.ones((120, 160, 3), np.uint8)
    *_, late, _ = drive(carried_by_fields(filmed, speckled(), wrong, behind, build({}), Clock(1e-9)))[1]
    assert "raise fit.time_budget_s" in late.notes[-1]

    def refused(*_):
        yield from ()
        raise error

    monkeypatch.setattr(explaining, "_by_fields", refused)
    news, (*_, kept, _) = drive(carried_by_fields(filmed, speckled(), wrong, behind, build({}), Clock()))
    assert kept is wrong
    assert str(error) in news[-1].text
