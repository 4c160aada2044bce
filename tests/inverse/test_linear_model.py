"""The linear engine: equal to the modal model, with derivatives, and near the material points where motions are small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from diffphys_ros.config import build, flat
from diffphys_ros.damping import Damping
from diffphys_ros.inverse import Checkpoint, solve
from diffphys_ros.inverse.engines import engines
from diffphys_ros.inverse.linear import linear_coordinates
from diffphys_ros.inverse.problem import Problem, pose_problem

from .conftest import YOUNG, make_prepared
from .test_solve import drive


@pytest.fixture(scope="module")
def problem(prepared, quick_settings) -> Problem:
    return pose_problem(prepared, None, quick_settings, dtype=torch.float64)


def unknowns_at(problem: Problem, z: torch.Tensor):
    return problem.layout.unpack(z, modes=problem.forward.basis.shape[2])


def coordinates(problem: Problem, z: torch.Tensor) -> torch.Tensor:
    return engines(problem.forward)["modes"].coordinates(unknowns_at(problem, z))


def test_at_the_start_values_it_is_the_modal_model(prepared, problem: Problem) -> None:
    found = coordinates(problem, torch.as_tensor(problem.layout.start)).numpy()
    expected = linear_coordinates(prepared)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_a_released_body_swings_as_the_modal_model_says() -> None:
    prepared = make_prepared()
    problem = pose_problem(prepared, None, build({"experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 1}), dtype=torch.float64)
    z = torch.as_tensor(problem.layout.start)
    z[problem.layout.slices["motion"]] = torch.linspace(-1, 1, 8, dtype=torch.float64)
    unknowns = unknowns_at(problem, z)
    expected = prepared.modal.respond(
        prepared.start.young,
        damping=Damping(0.2, 1e-3),
        load=prepared.start.force @ prepared.modal.footprint_load().T,
        period_s=prepared.clip.period_s,
        initial_displacement=unknowns.initial_displacement.numpy(),
        initial_velocity=unknowns.initial_velocity.numpy(),
    )
    np.testing.assert_allclose(coordinates(problem, z).numpy(), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("place", [0, 1, 2, 3, 5])
def test_derivatives_match_central_differences_though_frequencies_repeat(problem: Problem, place: int) -> None:
    """The bar is as thick as wide."""
    z = torch.as_tensor(problem.layout.start + 0.02).requires_grad_(True)
    (slope,) = torch.autograd.grad(coordinates(problem, z).square().sum(), z)
    step = torch.zeros_like(z)
    step[place] = 1e-5
    with torch.no_grad():
        values = [float(coordinates(problem, z + side * step).square().sum()) for side in (1, -1)]
    assert float(slope[place]) == pytest.approx((values[0] - values[1]) / 2e-5, rel=1e-5)


def test_both_engines_move_the_particles_alike(problem: Problem) -> None:
    z = torch.as_tensor(problem.layout.start)
    with torch.no_grad():
        unknowns = unknowns_at(problem, z)
        young = unknowns.young[problem.forward.part]
        linear, points = (engine.simulate(unknowns, young) for engine in engines(problem.forward).values())
    own = problem.disc.particles.own
    moved = points.displacement[:, own]
    assert float((linear.displacement[:, own] - moved).norm() / moved.norm()) < 0.1
    assert float((linear.F[:, own] - points.F[:, own]).norm() / (points.F[:, own] - torch.eye(3)).norm()) < 0.2


def test_what_modes_do_not_know_is_refused(problem: Problem) -> None:
    unknowns = unknowns_at(problem, torch.as_tensor(problem.layout.start))
    young = unknowns.young[problem.forward.part]
    with pytest.raises(ValueError, match="eigenmodes know neither fields nor densities"):
        engines(problem.forward)["modes"].simulate(unknowns, young, young)


def test_the_linear_schedule_finds_the_stiffness_without_a_simulation(prepared, quick_settings) -> None:
    """From start values of which E is 20 % off."""
    off = replace(prepared, start=replace(prepared.start, young=1.2 * prepared.start.young, log10_young_sd=np.full(2, 0.15)))
    news, recovery = drive(solve(off, None, build(flat(quick_settings) | {"experiment.schedule": "linear"})))
    assert recovery.simulation.engine == "modes"
    assert recovery.metrics["not_simulated"] == "not simulated: experiment.schedule is linear"
    young = [np.median(recovery.young[recovery.part == part]) for part in (1, 2)]
    np.testing.assert_allclose(young, YOUNG, rtol=0.05)
    assert recovery.metrics["misfit_start"] < 0.01
    losses = [n.loss for n in news if n.stage == "fit" and n.loss is not None]
    assert losses[-1] < 0.05 * losses[0]


def test_what_modes_do_not_know_stays_held_where_nothing_is_said_to_be(prepared, quick_settings) -> None:
    """Of densities and Poisson's ratios the modes are not asked; `fit.hold: [none]` frees them for a simulation alone."""
    settings = build(flat(quick_settings) | {"experiment.schedule": "linear", "fit.hold": ["none"]})
    _, recovery = drive(solve(prepared, None, settings))
    assert np.isfinite(recovery.young).all()


def test_the_linear_schedule_goes_on_from_its_checkpoint_to_the_same_answer(prepared, quick_settings, tmp_path) -> None:
    off = replace(prepared, start=replace(prepared.start, young=1.2 * prepared.start.young, log10_young_sd=np.full(2, 0.15)))
    settings = build(flat(quick_settings) | {"experiment.schedule": "linear"})
    whole = drive(solve(off, None, settings))[1]
    for states in (2, 1000):  # in the middle, and after its last state
        path = tmp_path / f"{states}.npz"
        steps = solve(off, None, settings, checkpoint=Checkpoint(path, every_s=1e9))
        for news in steps:
            if (news.stage == "fit" and news.iteration == states) or news.stage == "result":
                break
        steps.close()
        again = drive(solve(off, None, settings, checkpoint=Checkpoint(path, resume=True)))[1]
        np.testing.assert_array_equal(again.young, whole.young)
        np.testing.assert_array_equal(again.trajectory, whole.trajectory)
        assert again.simulation.engine == "modes"
