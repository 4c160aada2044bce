"""What goes with the square of the amplitude: left open where its factors are not known, computed where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.footprints import Footprint
from diffphys_ros.modes import ModalModel
from diffphys_ros.modes.response import driven
from diffphys_ros.modes.second_order import SecondOrder
from diffphys_ros.start import place
from diffphys_ros.start.force import ForceProblem
from diffphys_ros.start.free_tail import Physics
from diffphys_ros.start.large_swing import QUICK, SUBSTEPS, between, leading
from diffphys_ros.start.net_force import _Doubt
from diffphys_ros.start.stages import Fit, physics_again, run
from diffphys_ros.types import Body
from tests.made_bar import BETA, PERIOD_S, SMALL, bar, gust, modes_of, motion, settings, tracks, true_fit

YOUNG = np.array([9.0e5])  # Pa
PHYSICS = Physics(YOUNG, Damping(0.0, BETA), np.zeros(0))
LARGE = 1 / SMALL  # swings of a tenth of the bar


@pytest.fixture(scope="module")
def body() -> Body:
    """Its torsion swings nearly as fast as both its bendings together."""
    return bar(length=0.4, height=0.12, thickness=0.04, edges=(), pitch=2e-3)


@pytest.fixture(scope="module")
def modal(body: Body) -> ModalModel:
    return modes_of(body, YOUNG)


def swung(modal: ModalModel, q: np.ndarray) -> np.ndarray:
    """Basis coordinates (T, r) with those that products of the linear ones (T, r) drive."""
    squares = np.diag(modal.matrix(YOUNG))
    load = SecondOrder.of(modal, modal.modes).load(YOUNG, between(q))
    return q + driven(squares, 0.5 * BETA * squares, PERIOD_S, load, SUBSTEPS)


def blown(body: Body, modal: ModalModel, size: float) -> tuple[Fit, np.ndarray]:
    """The fit to a swing under a wind that bends the bar in both planes, and the force (T, 3)."""
    force = size * gust((0.0, 1.0, 0.6))
    return true_fit(body, modal, tracks(modal, swung(modal, motion(modal, YOUNG, force))), young=YOUNG), force


def missed(problem: ForceProblem) -> float:
    """Root mean square of what a wind misses of a frame, over its sigma."""
    return float(np.sqrt((problem.missed(problem.solve_under(PHYSICS, Footprint())) ** 2).sum(1).mean()))


def test_a_wind_that_bends_a_bar_in_both_planes_explains_its_twist(body: Body, modal: ModalModel) -> None:
    fit, force = blown(body, modal, LARGE)
    whole = fit.acting
    assert missed(whole) < 0.35 * missed(replace(whole, swing=None))
    assert place.best_footprint(whole, PHYSICS).family == "uniform"
    found = whole.solve_under(PHYSICS, Footprint()).force
    assert np.linalg.norm((found - force)[:, 1:]) < 0.1 * np.linalg.norm(force)


def test_what_a_force_does_is_in_the_tracks_that_it_is_read_from(body: Body, modal: ModalModel) -> None:
    """Products that were fitted to the tracks and taken off took 1.4 mm of a twist of 6 along (seed 848351): its push was found at .7 of its size."""
    fit = blown(body, modal, LARGE)[0]
    motion, problem = fit.evidence.motion, fit.acting
    whole = motion.first_order + motion.second_order
    seen = np.linalg.norm(problem.seen.data, axis=1) * np.sqrt(len(motion.points))
    basis = motion.seen_basis(problem.modal).reshape(-1, modal.modes)
    spanned = np.linalg.norm(whole.reshape(len(whole), -1) @ np.linalg.qr(basis)[0], axis=1)
    np.testing.assert_allclose(seen, spanned, rtol=1e-9)
    assert np.abs(problem.seen.data - fit.whole.seen.data).max() > problem.sigma_m / 10


def test_a_small_swing_is_read_as_it_was(body: Body, modal: ModalModel) -> None:
    whole = blown(body, modal, 1.0)[0].acting
    assert missed(whole) == pytest.approx(missed(replace(whole, swing=None)), rel=0.1)


def test_the_force_follows_the_motion_as_is_said(body: Body, modal: ModalModel) -> None:
    whole = blown(body, modal, LARGE)[0].acting
    load = whole.footprint_load(Footprint())
    change = 1e-3 * whole.sigma_m * np.random.default_rng(0).normal(size=whole.seen.data.shape)
    system = whole.system(PHYSICS, load)
    solved = [replace(whole, seen=replace(whole.seen, data=data)).solve(PHYSICS, load).force[whole.allowed].ravel() for data in (whole.seen.data, whole.seen.data + change)]
    gain = whole.gain(system)[0][: len(solved[0])]
    np.testing.assert_allclose(system.unit * np.einsum("ukd,kd->u", gain, change[whole.known]), solved[1] - solved[0], atol=1e-6 * np.abs(solved[0]).max())


def test_the_leading_coordinates_are_those_of_soft_modes_that_moved_the_tracks(body: Body, modal: ModalModel) -> None:
    q = motion(modal, YOUNG, LARGE * gust((0.0, 1.0, 0.6)))
    fit = true_fit(body, modal, tracks(modal, q), young=YOUNG)
    found = leading(fit.whole.seen, modal, fit.whole.sigma_m)
    assert found.shape[1] == 2  # the bendings; it twists at 32 times the square of the lower
    np.testing.assert_allclose(found, q[:, :2], atol=0.02 * np.abs(q).max())


def test_what_shortens_a_bent_bar_does_not_bend_it(body: Body, modal: ModalModel) -> None:
    """It swings by a third of its length, and is seen to be shorter then: no stretch, which would stiffen it."""
    whole = blown(body, modal, 3 * LARGE)[0].acting
    assert missed(whole) < 0.35 * missed(replace(whole, swing=None))


def test_what_follows_products_at_once_is_left_open_and_not_computed(body: Body, modal: ModalModel) -> None:
    swing = blown(body, modal, LARGE)[0].acting.swing
    assert swing is not None
    squares = np.diag(modal.matrix(YOUNG))
    moves = np.abs(swing.driven(YOUNG, squares, 0.5 * BETA * squares, np.eye(modal.modes))).max(0)
    assert moves[2] > 0.02 * np.abs(swing.coordinates).max()  # it twists
    np.testing.assert_array_equal(moves[squares > QUICK * squares[0]], 0.0)


def test_stiffness_and_damping_are_read_beside_it(body: Body, modal: ModalModel) -> None:
    """Without it they take on what a swing by a third of the bar is beyond its linear one: .0003 of log10 E and a tenth of the damping."""
    found = run(physics_again(), blown(body, modal, 3 * LARGE)[0]).physics
    assert abs(np.log10(found.young / YOUNG)) < 1e-4
    assert abs(found.damping.stiffness_s - BETA) < 0.02 * BETA


def test_the_force_and_what_it_may_be_under_other_modes_are_found_beside_it(body: Body, modal: ModalModel) -> None:
    fit = blown(body, modal, LARGE)[0]
    assert fit.last().swing is fit.acting.swing
    doubt = _Doubt(fit, None)
    np.testing.assert_allclose(doubt._net_under(PHYSICS, fit.modal), doubt.force, atol=1e-6 * np.abs(doubt.force).max())


def test_a_clip_that_begins_in_motion_tracks_of_first_order_an_outline_and_a_body_that_nothing_holds_have_no_products_left_open(body: Body, modal: ModalModel) -> None:
    fit = blown(body, modal, LARGE)[0]
    assert fit.acting.swing is not None
    assert fit.whole.swing is None
    normals = replace(fit.evidence.tracks, normals=np.tile([0.0, 1.0, 0.0], (len(fit.evidence.tracks.points[0]), 1)))
    moving = replace(fit.evidence, settings=settings(at_rest=False))
    others = (moving, replace(fit.evidence, first_order=True), replace(fit.evidence, tracks=normals), replace(fit.evidence, body=replace(body, clamped=False)))
    assert [each.second_order(fit.whole) for each in others] == [None, None, None, None]


def test_without_a_free_tail_nothing_is_left_open(body: Body, modal: ModalModel) -> None:
    fit = blown(body, modal, LARGE)[0]
    assert replace(fit, support=replace(fit.support, has_free_tail=False)).acting.swing is None
