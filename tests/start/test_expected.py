"""What is expected of a force along the body, where the motion hardly tells it, and what the motion makes of that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.modes import ModalModel
from diffphys_ros.start.along import ALONG
from diffphys_ros.start.expected import across_squared, expecting, missed_in_stiff_ways, shapes_in_stiff_ways, together
from diffphys_ros.start.net_force import net_force_doubt
from diffphys_ros.start.stages import Fit
from diffphys_ros.start.values import of_motion
from diffphys_ros.types import Body
from tests.made_bar import FORCED, FRAMES, YOUNG, gust, motion, tracks, true_fit

LONGER = 10  # frames by which the forced ones go on after the gust
SEEDS = range(6)
MANY = range(24)  # the noise of a fit makes a tenth of the force along


def fit_of(body: Body, modal: ModalModel, force: np.ndarray, seed: int) -> Fit:
    """Of the motion under a uniform force (T, 3), with frames beyond it that may carry one."""
    return true_fit(body, modal, tracks(modal, motion(modal, YOUNG, force), seed=seed), forced=slice(FORCED.start, FORCED.stop + LONGER))


def test_a_force_along_a_short_bar_is_found_as_far_as_the_motion_tells_it_and_on_no_side_where_there_is_none(body: Body, modal: ModalModel) -> None:
    shares = {}
    for along in (-ALONG, 0.0, ALONG):
        true = gust((along, 0.6, 0.8))
        course = true[:, 2] / np.linalg.norm(true[:, 2])
        shares[along] = np.array([of_motion(fit_of(body, modal, true, seed))["force"][:, 0] @ course for seed in MANY]) / np.linalg.norm(gust((ALONG, 0, 0)))
    assert 0.5 < shares[ALONG].mean() < 0.9
    assert -0.9 < shares[-ALONG].mean() < -0.5
    assert abs(shares[0.0].mean()) < 0.05


def test_tracks_make_no_more_of_a_force_along_than_the_scatter_that_is_stated(body: Body, modal: ModalModel) -> None:
    doubts = [net_force_doubt(fit_of(body, modal, gust((0.0, 0.6, 0.8)), seed), np.full(2, 0.01)) for seed in SEEDS]
    found = np.array([doubt.found[:, 0] for doubt in doubts])
    stated = np.array([np.diag(doubt.scatter)[::3] for doubt in doubts])
    ratio = np.sqrt((found**2).mean() / stated.mean())
    assert 0.2 < ratio < 1, ratio  # errors of tracks are alike over a quarter period in films, not here


def test_a_force_along_the_body_ends_with_the_one_across(body: Body, modal: ModalModel) -> None:
    true = gust((ALONG, 0.6, 0.8))
    for seed in SEEDS:
        quiet = of_motion(fit_of(body, modal, true, seed))["force"][FORCED.stop + 3 :, 0]
        assert np.linalg.norm(quiet) < 1e-3 * np.linalg.norm(true)


def test_what_is_missed_of_the_motion_leaves_less_of_a_force_along_the_body(body: Body, modal: ModalModel) -> None:
    fit = fit_of(body, modal, gust((ALONG, 0.6, 0.8)), 0)
    sizes = [np.linalg.norm(fit.last(missed=missed).solve(fit.physics, fit.load).force[:, 0]) for missed in (0.0, 10.0, 100.0)]
    assert sizes[0] > 2 * sizes[1] > 4 * sizes[2]


def test_what_is_stated_is_of_the_force_that_is_found(body: Body, modal: ModalModel) -> None:
    fit = fit_of(body, modal, gust((ALONG, 0.6, 0.8)), 0)
    doubt = net_force_doubt(fit, np.full(2, 0.01))
    net = of_motion(fit)["force"] * fit.whole.footprint_volume(fit.footprint)
    np.testing.assert_allclose(doubt.found, net[doubt.frames], rtol=1e-9, atol=1e-9 * np.abs(net).max())


def test_what_is_missed_of_a_swing_in_another_shape_does_not_hide_a_force_along(body: Body, modal: ModalModel) -> None:
    fit = fit_of(body, modal, gust((ALONG, 0.6, 0.8)), 0)
    problem = fit.whole
    own = shapes_in_stiff_ways(problem, fit.physics, fit.load)[0]
    swing = np.linalg.svd(problem.seen.data, full_matrices=False)[2][0]
    swing = swing - (swing @ own) * own
    error = 6.0 * problem.sigma_m * np.sin(np.arange(len(problem.known)))[:, None]

    def missed(shape: np.ndarray) -> tuple[float, float]:
        off = replace(problem, seen=replace(problem.seen, data=problem.seen.data + error * shape))
        found = off.solve(fit.physics, fit.load)
        return float((off.missed(found) ** 2).sum(1).mean()), float(missed_in_stiff_ways(off, fit.physics, found, fit.load)[0])

    nothing, other, same = (missed(shape) for shape in (np.zeros_like(own), swing / np.linalg.norm(swing), own))
    assert other[0] > 5 * nothing[0]
    assert other[1] == pytest.approx(nothing[1], rel=0.3)
    assert same[1] > 20 * nothing[1]


def test_what_is_missed_grows_with_the_second_order_of_the_motion_while_the_force_acts(body: Body, modal: ModalModel) -> None:
    fit = fit_of(body, modal, gust((ALONG, 0.6, 0.8)), 0)
    problem, own = replace(fit.whole, common_m=1e-9), shapes_in_stiff_ways(fit.whole, fit.physics, fit.load)[0]
    course = np.where(problem.allowed, 3.0, 1.0)[:, None] * 1e-3

    def found(second: np.ndarray) -> tuple[float, float]:
        last = expecting(replace(problem, seen=replace(problem.seen, second_order=second)), fit.physics, fit.load)
        missed = missed_in_stiff_ways(last, fit.physics, problem.solve(fit.physics, fit.load), fit.load)[0]
        return float(missed), float(np.linalg.norm(last.solve(fit.physics, fit.load).force[:, 0]))

    even, growing = found(np.ones_like(course) * own), found(course * own)
    assert growing[0] == pytest.approx(9 * even[0], rel=0.01)
    assert growing[1] < 0.7 * even[1]


def test_without_a_force_across_nothing_is_expected_along(body: Body, modal: ModalModel) -> None:
    still = fit_of(body, modal, np.zeros((FRAMES, 3)), 0)
    none = still.whole
    none.seen.data[:] = 0.0
    assert expecting(none, still.physics, still.load) is none


def test_the_size_in_a_frame_is_that_of_the_frames_about_it_and_what_is_expected_goes_together() -> None:
    force, frames, along = np.tile([5.0, 3.0, 4.0], (6, 1)), np.array([0, 1, 2, 3, 20, 21]), np.array([[1.0, 0.0, 0.0]])
    squared = across_squared(force, frames, along)
    np.testing.assert_allclose(squared, 25.0)
    covariance = together(squared, frames)
    np.testing.assert_allclose(np.diag(covariance), 25.0)
    assert covariance[0, 1] > 20
    assert covariance[3, 4] < 1e-6
