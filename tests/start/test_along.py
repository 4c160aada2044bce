"""A force along a body, which hardly moves it, where the body leaves its held face askew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.modes import ModalModel
from diffphys_ros.start.along import DEARER, Stiff, along_of
from diffphys_ros.start.net_force import net_force_doubt
from diffphys_ros.start.stages import Fit
from diffphys_ros.start.values import of_motion
from diffphys_ros.types import Body
from tests.made_bar import YOUNG, bar, gust, modes_of, motion, tracks, true_fit

LEAN = np.deg2rad(22.0)
ALONG = np.array([np.cos(LEAN), np.sin(LEAN), 0.0])
ACROSS = np.array([-np.sin(LEAN), np.cos(LEAN), 0.0])
DEPTH = np.array([0.0, 0.0, 1.0])
ONE = YOUNG[:1]


def leaning(*, length: float = 0.3, height: float = 0.06, pitch: float = 2e-3) -> Body:
    """A bar of one material that leaves the held plane x = 0 askew."""
    straight = bar(length=length, height=2 * (height + length * np.tan(LEAN)), thickness=0.05, edges=(), pitch=pitch)
    x, y = np.meshgrid(*(start + pitch * np.arange(count) for start, count in zip(straight.origin, straight.inside.shape, strict=True)), indexing="ij")
    return replace(straight, inside=np.abs(np.cos(LEAN) * y - np.sin(LEAN) * x) < height / 2)


@pytest.fixture(scope="module")
def body() -> Body:
    return leaning()


@pytest.fixture(scope="module")
def modal(body: Body) -> ModalModel:
    return modes_of(body, ONE)


def fit_of(body: Body, modal: ModalModel, force: np.ndarray, *, noise: float = 1.0) -> Fit:
    """To the motion under a uniform force (T, 3), by tracks that are said to be so much worse than they are."""
    seen = tracks(modal, motion(modal, ONE, force), points=modal.nodes[modal.nodes[:, 2] > 0.99 * modal.nodes[:, 2].max()])
    return true_fit(body, modal, replace(seen, noise_m=noise * seen.noise_m), young=ONE)


def found(fit: Fit) -> np.ndarray:
    """The uniform force (T, 3)."""
    return of_motion(fit)["force"]


def test_a_gust_across_a_bar_that_leaves_its_held_face_askew_keeps_its_direction(body: Body, modal: ModalModel) -> None:
    true = gust(tuple(0.8 * ACROSS + 0.6 * DEPTH))
    off = found(fit_of(body, modal, true)) - true
    assert np.linalg.norm(off) < 0.1 * np.linalg.norm(true)


@pytest.mark.parametrize("share", [-0.3, 0.3])
def test_a_gust_along_such_a_bar_which_hardly_moves_it_is_found_as_far_as_tracks_tell_it(body: Body, modal: ModalModel, share: float) -> None:
    true = gust(tuple(share * ALONG + 0.8 * ACROSS + 0.5 * DEPTH))
    found_of_true = [(found(fit_of(body, modal, true, noise=noise)) @ ALONG) @ (true @ ALONG) / np.linalg.norm(true @ ALONG) ** 2 for noise in (1.0, 3.0, 30.0)]
    assert 0.9 > found_of_true[0] > 0.3, found_of_true
    assert found_of_true[0] > 2 * found_of_true[1] > 4 * abs(found_of_true[2])
    assert abs(found_of_true[2]) < 0.1


def unseen(fit: Fit) -> tuple[float, float]:
    """Deviations along the bar and across it of what the motion does not tell of the force, over the one found."""
    doubt = net_force_doubt(fit, np.full(1, 0.01))
    covariance = np.einsum("fcfd->cd", doubt.unseen.reshape(2 * [len(doubt.frames), 3]))
    along, across = (float(np.sqrt(way @ covariance @ way) / np.linalg.norm(doubt.found)) for way in (ALONG, ACROSS))
    return along, across


def test_a_force_along_such_a_bar_has_the_deviation_of_what_is_not_seen_which_is_less_by_good_tracks(body: Body, modal: ModalModel) -> None:
    by_bad, by_good = (unseen(fit_of(body, modal, gust(tuple(ACROSS)), noise=noise)) for noise in (5.0, 1.0))
    assert 0.22 < by_bad[0] < 0.29, by_bad
    assert by_good[0] < 0.6 * by_bad[0], by_good
    assert by_good[1] < 0.2 * by_bad[0], by_good


@pytest.mark.parametrize("reach", [0.3, 0.5])
def test_a_branch_does_not_turn_what_is_along_the_stem(reach: float) -> None:
    stem = bar(length=0.3, height=0.3, edges=())
    x, y = np.meshgrid(*(start + stem.pitch_m * np.arange(count) for start, count in zip(stem.origin, stem.inside.shape, strict=True)), indexing="ij")
    branch = (np.abs(x - 0.2) < 0.025) & (y > 0) & (y < reach * 0.3)
    np.testing.assert_allclose(along_of(replace(stem, inside=(np.abs(y) < 0.025) | branch)), [1, 0, 0], atol=1e-9)


def test_a_body_that_nothing_holds_has_its_frame_s_way_along() -> None:
    np.testing.assert_array_equal(along_of(replace(leaning(), clamped=False)), [1, 0, 0])


def sheet(*, height: float = 0.2, thickness: float = 0.012, clamped: bool = True) -> tuple[Body, ModalModel]:
    """1:25 of its length thick, where nothing else is said."""
    body = bar(length=0.3, height=height, thickness=thickness, edges=(), pitch=4e-3, clamped=clamped)
    return body, modes_of(body, ONE, count=12)


@pytest.mark.parametrize("direction", [(0.0, 0.9, 0.3), (0.0, 0.3, 0.9), (0.0, 0.0, 1.0)])
def test_a_force_in_the_plane_of_a_sheet_is_found_by_the_little_that_it_moves(direction: tuple[float, float, float]) -> None:
    body, modal = sheet()
    true = gust(direction, peak=300.0)
    fit = fit_of(body, modal, true)
    off = found(fit) - true
    assert np.linalg.norm(off) < 0.25 * np.linalg.norm(true)
    doubt = net_force_doubt(fit, np.full(1, 0.01))
    stated = np.sqrt(doubt.variance[:, 1, 1]) / fit.whole.footprint_volume(fit.footprint)
    in_plane = np.abs(off[doubt.frames, 1]) / stated
    assert (in_plane < 2).mean() > 0.9


@pytest.mark.parametrize(("height", "thickness", "ways"), [(0.2, 0.012, [[1, 0, 0], [0, 1, 0]]), (0.2, 0.15, [[1, 0, 0]]), (0.024, 0.2, [[1, 0, 0], [0, 0, 1]])])
def test_a_body_is_stiff_along_and_where_it_is_much_thicker_than_the_other_way(height: float, thickness: float, ways: list[list[float]]) -> None:
    body, modal = sheet(height=height, thickness=thickness)
    np.testing.assert_allclose(Stiff.of(along_of(body), modal, has_depth=True).ways, ways, atol=1e-6)


def test_a_sheet_that_nothing_holds_moves_any_way() -> None:
    body, modal = sheet(clamped=False)
    assert len(Stiff.of(along_of(body), modal, has_depth=True).ways) == 1


def test_a_sheet_of_which_no_depth_is_seen_is_stiff_along_alone() -> None:
    body, modal = sheet()
    assert len(Stiff.of(along_of(body), modal, has_depth=False).ways) == 1


def test_a_force_in_the_plane_of_a_sheet_is_priced_by_what_it_moves_and_one_along_as_if_it_moved_more() -> None:
    """What a swing across needs says nothing of it: a cantilever's sag goes with the inverse square of its depth, and shear adds to that of a deep one."""
    body, modal = sheet()
    stiff = fit_of(body, modal, gust()).whole.stiff
    along, in_plane, across = np.linalg.norm(stiff.costs, axis=0)
    assert 1 < in_plane / (0.012 / 0.2) ** 2 < 3
    assert across == pytest.approx(1)
    assert along == pytest.approx(DEARER)
