"""The loss and its gradient through simulation, skinning and priors."""

import dataclasses

import numpy as np
import pytest
import torch

from diffphys_ros.config import build
from diffphys_ros.inverse.curvature import track_hessian
from diffphys_ros.inverse.linear import linear_motion
from diffphys_ros.inverse.model import Model
from diffphys_ros.inverse.observed import TrackTarget, acceleration_scale
from diffphys_ros.inverse.problem import pose_problem
from diffphys_ros.inverse.unknowns import BLOCKS

from .conftest import make_camera, make_prepared


@pytest.fixture(scope="module")
def problem(prepared, quick_settings):
    return pose_problem(prepared, None, quick_settings)


def test_the_frozen_first_frame_costs_one_half_and_the_observed_motion_nothing(prepared):
    target = TrackTarget.of(prepared.tracks, prepared.body, prepared.clip.camera, dtype=torch.float64, device="cpu")
    points0 = target.points0.numpy()
    assert float(target.loss(torch.zeros(*target.weight.shape, 3, dtype=torch.float64))) == pytest.approx(0.5)
    exact = torch.as_tensor(linear_motion(prepared, *prepared.modal.evaluate(points0))[0])
    assert float(target.loss(exact)) < 1e-8


def test_without_depth_motion_along_the_line_of_sight_costs_almost_nothing():
    prepared = make_prepared(has_depth=False)
    target = TrackTarget.of(prepared.tracks, prepared.body, make_camera(), dtype=torch.float64, device="cpu")
    exact = torch.as_tensor(linear_motion(prepared, *prepared.modal.evaluate(target.points0.numpy()))[0])
    rays = target.points0.numpy() - prepared.body.to_body(make_camera().position)
    along = torch.as_tensor(0.01 * rays / np.linalg.norm(rays, axis=1, keepdims=True))
    across = torch.tensor([0.0, 0.01, 0.0], dtype=torch.float64)
    assert float(target.loss(exact)) < 1e-6
    assert float(target.loss(exact + along)) < 0.05 * float(target.loss(exact + across))


@pytest.fixture(scope="module")
def double_problem(prepared, quick_settings):
    return pose_problem(prepared, None, quick_settings, dtype=torch.float64)


def cost(problem, z):
    with torch.no_grad():
        return Model(problem, z)().value


@pytest.mark.parametrize("index", [0, 1, 2, 3, 4, 5, 8])
def test_the_gradient_of_the_loss_matches_central_differences(double_problem, index):
    """log E of both parts, mass damping, stiffness damping, force: through every frame, in double precision."""
    z = double_problem.layout.start + 0.02
    model = Model(double_problem, z)
    gradient = model.space(BLOCKS).gradient(model().total)
    step = np.zeros_like(z)
    step[index] = 1e-4
    numeric = (cost(double_problem, z + step) - cost(double_problem, z - step)) / 2e-4
    assert gradient[index] == pytest.approx(numeric, rel=1e-4, abs=1e-9)


def test_the_modal_hessian_predicts_the_curvature_of_the_simulated_loss(prepared, problem):
    hessian = track_hessian(prepared, problem.layout, problem.target, initial_modes=0)
    z, step = problem.layout.start, np.zeros(problem.layout.size)
    step[0] = 0.05
    values = [Model(problem, z + s * step)().parts["track"] for s in (-1, 0, 1)]
    numeric = (values[0] - 2 * values[1] + values[2]) / 0.05**2
    assert hessian[0, 0] == pytest.approx(numeric, rel=0.4)
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)


def test_a_simulation_that_leaves_its_bounds_costs_infinity_and_says_why(problem):
    z = problem.layout.start.copy()
    z[problem.layout.force_slice] = 1e4
    terms = Model(problem, z)()
    assert terms.value == np.inf
    assert "frame" in problem.objective.failures[-1]


def test_the_unit_of_force_is_the_size_of_the_acceleration_without_the_noise(prepared):
    quiet = acceleration_scale(dataclasses.replace(prepared.tracks, noise_m=0.0), prepared.clip.period_s)
    rng = np.random.default_rng(0)
    shaken = prepared.tracks.points + rng.normal(0, prepared.tracks.noise_m, prepared.tracks.points.shape)
    noisy = acceleration_scale(dataclasses.replace(prepared.tracks, points=shaken), prepared.clip.period_s)
    assert noisy == pytest.approx(quiet, rel=0.05)


def test_gravity_settles_before_frame_zero_so_that_nothing_falls():
    prepared = make_prepared(gravity=(0.0, -3.0, 0.0))
    settings = build({"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 1})
    problem = pose_problem(prepared, None, settings)
    z = problem.layout.start.copy()
    z[problem.layout.force_slice] = 0.0
    with torch.no_grad():
        motion = Model(problem, z)().motion
    sag = np.abs(prepared.modal.evaluate(prepared.body.to_body(prepared.tracks.points[0]))[0] @ prepared.modal.gravity_coordinates(prepared.start.young))
    assert float(motion.displacement.abs().max()) < 0.06 * sag.max()


@pytest.mark.parametrize("block", ["density", "poisson"])
def test_the_gradient_with_respect_to_densities_and_poisson_s_ratios_matches_central_differences(prepared, block):
    """Of every part; under gravity, which bends the body in frame 0 already."""
    heavy = make_prepared(gravity=(0.0, -3.0, 0.0))
    settings = build({"scene.at_rest": True, "experiment.cells": 3, "experiment.per_cell": 1.5, "fit.iterations": 1, "fit.hold": ["none"]})
    problem = pose_problem(heavy, None, settings, dtype=torch.float64)
    z, places = problem.layout.start + 0.02, problem.layout.index([block])
    model = Model(problem, z)
    gradient = model.space(BLOCKS).gradient(model().total)[places]
    for place, slope in zip(places, gradient, strict=True):
        step = np.zeros_like(z)
        step[place] = 1e-4
        assert slope == pytest.approx((cost(problem, z + step) - cost(problem, z - step)) / 2e-4, rel=1e-4, abs=1e-9)
