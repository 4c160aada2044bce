"""The whole solver on a bar whose answer is known, without images."""

import dataclasses

import numpy as np
import pytest

from diffphys_ros import result
from diffphys_ros.config import build, flat
from diffphys_ros.damping import Damping
from diffphys_ros.errors import InputError
from diffphys_ros.inverse import Checkpoint, solve
from diffphys_ros.inverse.apparent_stiffness import measure_apparent, motion_share
from diffphys_ros.inverse.forward import discretise
from diffphys_ros.inverse.resolution import make_plan
from diffphys_ros.inverse.solve import MATERIAL, suited
from diffphys_ros.particles import dense_points, fill, fit_grid
from diffphys_ros.resimulate import simulate_again

from .conftest import YOUNG, make_body, make_tracks


def drive(steps):
    """All news and the returned value of a generator."""
    news = []
    while True:
        try:
            news.append(next(steps))
        except StopIteration as stop:
            return news, stop.value


@pytest.fixture(scope="module")
def answer(prepared, quick_settings):
    return drive(solve(prepared, None, quick_settings))


@pytest.fixture(scope="module")
def off(prepared):
    """The same clip with start values of which E is 30 % off."""
    return dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, young=1.3 * prepared.start.young, log10_young_sd=np.full(2, 0.15)))


def test_a_simulation_begun_at_the_truth_stays_there(answer):
    _, recovery = answer
    np.testing.assert_allclose(recovery.metrics["young_refined_pa"], YOUNG, rtol=0.06)
    assert recovery.metrics["track_rms_refined_m"] < 4e-4


def test_the_correction_of_the_grid_is_applied_once(prepared, quick_settings, tmp_path):
    """On a grid that is too stiff: a softer bar was simulated, and its correction is the bar's modulus."""
    weaker = dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, force=0.6 * prepared.start.force))  # its linear motion falls short
    _, recovery = drive(solve(weaker, None, build(flat(quick_settings) | {"experiment.per_cell": 1.0})))
    assert recovery.simulation.engine == "mpm"
    assert recovery.apparent_stiffness > 1.05
    young, solver = (np.array([np.median(values[recovery.part == p]) for p in (1, 2)]) for values in (recovery.young, recovery.young_solver))
    np.testing.assert_allclose(solver * recovery.apparent_stiffness, young, rtol=1e-6)
    np.testing.assert_allclose(young, YOUNG, rtol=0.04)
    result.save(recovery, prepared.clip, quick_settings, tmp_path)
    stored = result.load(tmp_path)
    motion = np.abs(stored.trajectory - stored.trajectory[0]).max()
    as_simulated, corrected = (simulate_again(with_young(stored, values)) for values in (stored.young_solver, stored.young))
    np.testing.assert_array_equal(as_simulated, stored.trajectory)
    assert np.abs(corrected - stored.trajectory).max() > 0.02 * motion


def with_young(recovery, young):
    """The result, to be simulated with Young's modulus (N,) of its own particles."""
    every = recovery.simulation.young.copy()
    every[~recovery.simulation.ghost] = young
    return dataclasses.replace(recovery, simulation=dataclasses.replace(recovery.simulation, young=every))


def test_the_loss_falls_and_progress_says_what_is_left(answer):
    news, recovery = answer
    fits = [n for n in news if n.stage == "fit"]
    assert [n.iteration for n in fits] == list(range(len(fits)))
    assert fits[-1].loss <= fits[0].loss
    assert all(n.seconds_left is not None for n in fits[1:])
    assert recovery.metrics["loss_history"] == [n.loss for n in fits]


def test_the_net_force_is_the_density_times_the_volume(prepared, answer):
    _, recovery = answer
    free = recovery.force[:, 0].astype(float) * recovery.volume[~recovery.clamped].sum()
    np.testing.assert_allclose(recovery.net_force(), free, rtol=1e-5, atol=1e-9)
    assert recovery.volume.sum() == pytest.approx(prepared.body.volume_m3, rel=1e-6)


def test_the_particles_that_the_clamp_holds_are_its_neighbours_and_hardly_move(answer):
    _, recovery = answer
    held = recovery.clamped
    assert 0 < recovery.volume[held].sum() < 0.1 * recovery.volume.sum()
    assert recovery.points[held, 0].max() < recovery.points[~held, 0].min()
    assert np.ptp(recovery.trajectory[:, held], axis=0).max() < 0.02 * np.ptp(recovery.trajectory, axis=0).max()


def test_the_fields_have_one_row_per_particle_and_frame(prepared, answer):
    _, recovery = answer
    frames, count = len(prepared.clip), len(recovery.points)
    assert recovery.force.shape == recovery.trajectory.shape == (frames, count, 3)
    np.testing.assert_allclose(recovery.trajectory[0], recovery.points, atol=1e-6)
    assert not recovery.force[~prepared.start.forced].any()


def test_two_runs_are_equal_to_the_bit(prepared, quick_settings, answer, tmp_path):
    _, again = drive(solve(prepared, None, quick_settings))
    first, second = (result.save(r, prepared.clip, quick_settings, tmp_path / n).read_bytes() for r, n in ((answer[1], "first"), (again, "second")))
    assert first == second


def test_an_interrupted_fit_resumes_where_it_was(prepared, quick_settings, answer, tmp_path):
    steps = solve(prepared, None, quick_settings, checkpoint=Checkpoint(tmp_path / "c.npz", every_s=1e9))
    while next(steps).iteration < 2:
        pass
    steps.close()
    _, resumed = drive(solve(prepared, None, quick_settings, checkpoint=Checkpoint(tmp_path / "c.npz", resume=True)))
    np.testing.assert_array_equal(resumed.young, answer[1].young)
    np.testing.assert_array_equal(resumed.force, answer[1].force)
    assert resumed.metrics["loss_history"] == answer[1].metrics["loss_history"]


def test_a_checkpoint_of_another_job_is_refused(prepared, quick_settings, tmp_path):
    steps = solve(prepared, None, quick_settings, checkpoint=Checkpoint(tmp_path / "c.npz", every_s=1e9))
    while next(steps).iteration < 1:
        pass
    steps.close()
    other = build(flat(quick_settings) | {"experiment.track_weight": 2.0})
    with pytest.raises(InputError, match="belongs to another clip or other settings"):
        drive(solve(prepared, None, other, checkpoint=Checkpoint(tmp_path / "c.npz", resume=True)))
    with pytest.raises(InputError, match="there is none to resume from"):
        drive(solve(prepared, None, other, checkpoint=Checkpoint(tmp_path / "none.npz", resume=True)))


def test_the_solver_comes_back_from_start_values_that_are_far_off(off, quick_settings):
    _, recovery = drive(solve(off, None, build(flat(quick_settings) | {"fit.iterations": 10})))
    assert recovery.metrics["refined"] is True
    young = np.array([np.median(recovery.young[recovery.part == p]) for p in (1, 2)])
    np.testing.assert_allclose(young, YOUNG, rtol=0.12)
    stated = np.array([recovery.log10_young_sd[recovery.part == p].max() for p in (1, 2)])
    moved = np.log10(young / off.start.young)  # what the engines differ by is in the deviation
    np.testing.assert_allclose(stated, np.hypot(np.hypot(0.15, moved), recovery.metrics["expected_log10_error_of_grid"]), rtol=1e-4)


def test_where_the_simulation_misses_the_track_noise_the_start_values_are_the_result(prepared, quick_settings):
    strict = dataclasses.replace(prepared, tracks=dataclasses.replace(prepared.tracks, noise_m=1e-7))
    _, recovery = drive(solve(strict, None, quick_settings))
    assert recovery.metrics["refined"] is False
    for part, young in enumerate(YOUNG, 1):
        np.testing.assert_array_equal(recovery.young[recovery.part == part], young)


def test_an_unknown_initial_motion_is_recovered(prepared):
    """A bar released from a bent shape, no force at all."""
    modal, body, clip = prepared.modal, prepared.body, prepared.clip
    a = np.zeros(modal.modes)
    a[0] = 0.012 / np.abs(modal.evaluate(body.to_body(prepared.tracks.points[0]))[0][..., 0]).max()
    frames = len(clip)
    still = np.zeros((frames, 3))
    q = modal.respond(YOUNG, damping=Damping(0.2, 1e-3), load=still @ np.zeros((3, modal.modes)), period_s=clip.period_s, initial_displacement=a)
    points0 = prepared.tracks.points[0]
    points = points0 + np.einsum("mcr,tr->tmc", modal.evaluate(points0)[0], q - q[:1])
    tracks = dataclasses.replace(prepared.tracks, points=points)
    start = dataclasses.replace(prepared.start, forced=np.zeros(frames, bool), force=still, initial_displacement=0.8 * a)
    settings = build({"experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 4})
    _, recovery = drive(solve(dataclasses.replace(prepared, tracks=tracks, start=start), None, settings))
    assert recovery.metrics["track_rms_refined_m"] < 0.1 * np.sqrt(((points - points[:1]) ** 2).mean())


@pytest.mark.parametrize("per_cell", [1.5, 2.0])
def test_a_fitted_grid_is_measured_right_and_one_that_holds_the_body_behind_its_face_soft(prepared, per_cell):
    body = make_body()
    particles = fill(body, 0.1 / 3, per_cell)
    fitted = fit_grid(particles, dx=0.1 / 3, reach_m=0.02, clamped=True)
    behind = dataclasses.replace(fitted, origin=fitted.origin - [fitted.dx / 2, 0, 0])
    near, soft = (measure_apparent(particles, grid, prepared.modal, YOUNG, np.array([1.0])).value for grid in (fitted, behind))
    assert near == pytest.approx(1.0, abs=0.03)
    assert soft < near - 0.08


def test_the_share_of_a_mode_is_its_part_of_the_motion(prepared):
    _, shapes = np.linalg.eigh(prepared.modal.elastic(YOUNG))
    swing = np.outer(np.sin(np.arange(20.0)), shapes[:, 0]) + 0.5 * np.outer(np.sin(np.arange(20.0)), shapes[:, 1])
    np.testing.assert_allclose(motion_share(prepared.modal, YOUNG, swing), [0.8, 0.2], atol=1e-9)


def test_a_start_without_force_is_posed_and_the_search_finds_the_gust(prepared, quick_settings):
    still = dataclasses.replace(prepared, start=dataclasses.replace(prepared.start, force=np.zeros_like(prepared.start.force)))
    _, recovery = drive(solve(still, None, build(flat(quick_settings) | {"fit.iterations": 4})))
    assert recovery.metrics["track_rms_refined_m"] < 0.3 * recovery.metrics["track_rms_start_m"]


def test_particles_taken_from_gaussians_are_laid_out_and_their_stiffness_is_measured(prepared):
    front = np.stack(np.meshgrid(np.arange(0.0025, 0.3, 0.005), np.arange(-0.0475, 0.05, 0.005), [0.05]), -1).reshape(-1, 3)
    dense = dense_points(prepared.body, front)
    settings = build({"experiment.downsample_ratio": 0.03})
    plan = make_plan(prepared.body, YOUNG, frames=13, period_s=1 / 30, settings=settings, device="cpu", dense=len(dense.x))
    disc = discretise(prepared, plan, device="cpu", dense=dense)
    own = disc.particles.own
    assert len(own) == pytest.approx(0.03 * len(dense.x), rel=0.02)
    assert disc.particles.mass[own].sum() == pytest.approx(600 * prepared.body.volume_m3, rel=1e-9)
    assert disc.apparent == pytest.approx(0.96, abs=0.06)


def test_a_share_of_gaussians_is_refused_where_there_are_none(prepared):
    with pytest.raises(InputError, match=r"experiment.downsample_ratio: there are 0 Gaussians"):
        drive(solve(prepared, None, build({"experiment.downsample_ratio": 0.01})))


def test_a_good_start_is_not_looked_for_elsewhere_because_tracks_weigh_nothing(prepared, quick_settings):
    settings = build(flat(quick_settings) | {"experiment.track_weight": 0.0, "fit.iterations": 1})
    news, _ = drive(solve(prepared, None, settings))
    assert not any("trying other moduli" in (n.text or "") for n in news)


def test_frequencies_that_the_shape_as_told_does_not_have_leave_the_stiffness_as_the_modes_found_it(prepared, quick_settings):
    """A leading mode that swings 6 % faster than the shape alone would have it: an outline that is a little off, not a stiffer material."""
    modal = prepared.modal.retuned(YOUNG, np.array([0.06, 0.0]))
    seen = dataclasses.replace(prepared, modal=modal, tracks=make_tracks(prepared.body, modal, prepared.start))
    _, recovery = drive(solve(seen, None, quick_settings))
    np.testing.assert_allclose(np.log10(recovery.metrics["young_refined_pa"] / YOUNG), 0.0, atol=0.02)
    assert recovery.metrics["track_rms_refined_m"] < 4e-4


def test_of_what_bounces_on_a_floor_no_fit_moves_the_material(prepared):
    above = build({"scene.floor_z_m": -1.0, "fit.hold": ["damping"]})
    free = dataclasses.replace(prepared, body=dataclasses.replace(prepared.body, clamped=False))
    assert suited(free, above).fit.hold == ["damping", *MATERIAL]
    assert suited(prepared, above).fit.hold == ["damping"], "a clamp holds it"
