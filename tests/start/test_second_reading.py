"""Claims about the place of a force, read from tracks whose motion is of first order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.footprints import Footprint
from diffphys_ros.modes import interpolation
from diffphys_ros.modes.model import ModalModel
from diffphys_ros.start.second_reading import read_again
from diffphys_ros.types import Body, MaterialDoubt, StartValues, Tracks
from tests.made_bar import BETA, FORCED, FRAMES, PERIOD_S, YOUNG, bar, camera, gust, modes_of, settings, tracks

PUSHED = Footprint("gaussian", np.array([0.12, 0.02, 0.035]))  # above the clamp, off the axis
PUSH = 12  # times a wind that moves the bar about as far
AT_TIP, TIP_PUSH = Footprint("gaussian", np.array([0.27, 0.0, 0.05])), 2.0  # and its strength over that wind's: a wind explains it nearly as well


@pytest.fixture(scope="module")
def body() -> Body:
    return bar()


@pytest.fixture(scope="module")
def modal(body: Body) -> ModalModel:
    return modes_of(body, YOUNG)


def seen_under(modal: ModalModel, footprint: Footprint, force: np.ndarray) -> Tracks:
    q = modal.respond(YOUNG, damping=Damping(0.0, BETA), load=force @ modal.footprint_load(footprint.weights).T, period_s=PERIOD_S)
    return tracks(modal, q)


def started(body: Body, modal: ModalModel, footprint: Footprint, force: np.ndarray) -> StartValues:
    """True but for the place of the force."""
    forced = np.zeros(FRAMES, bool)
    forced[FORCED] = True
    still, hz = np.zeros(modal.modes), modal.frequencies(YOUNG)
    return StartValues(
        YOUNG.copy(), np.full(2, 0.05), Damping(0.0, BETA), forced, footprint, force, still, still, hz, hz[:1], np.zeros(1), 1e-3,
        np.ones(2, bool), ("seen", "seen"), True, True, np.full(2, 0.01), np.full(2, np.nan), MaterialDoubt.none(2), body.density, body.poisson,
    )  # fmt: skip


def net_force(modal: ModalModel, start: StartValues) -> np.ndarray:
    """(T, 3) [N]."""
    points, volume, _ = interpolation.quadrature(modal.nodes, modal.tets)
    return start.force * (volume * start.footprint.weights(points)).sum()


@pytest.mark.parametrize("refined", [False, True])
def test_a_push_that_was_taken_for_a_wind_is_found_where_it_was(body: Body, modal: ModalModel, refined: bool) -> None:
    pushed = PUSH * gust()
    begun = started(body, modal, Footprint(), gust())
    again = read_again(body, seen_under(modal, PUSHED, pushed), PERIOD_S, settings(at_rest=True), begun, modal, camera=camera(), refined=refined)
    assert again is not None
    assert again.footprint.family == "gaussian"
    np.testing.assert_allclose(again.footprint.parameters[:2], PUSHED.parameters[:2], atol=0.02)
    true = net_force(modal, replace(begun, footprint=PUSHED, force=pushed))
    assert np.linalg.norm(net_force(modal, again) - true) < 0.25 * np.linalg.norm(true) < 0.5 * np.linalg.norm(net_force(modal, begun) - true)
    np.testing.assert_array_equal(again.forced, begun.forced)
    if not refined:
        np.testing.assert_array_equal(again.young, YOUNG)
    np.testing.assert_allclose(again.young, YOUNG, rtol=0.03)


def test_a_push_at_the_tip_is_told_from_a_wind_by_what_remains_at_first_order(body: Body, modal: ModalModel) -> None:
    """It moves the bar as a wind of twice its net force would; the two differ by a fraction of what linear modes usually miss."""
    pushed = TIP_PUSH * gust()
    seen = seen_under(modal, AT_TIP, pushed)
    begun = started(body, modal, Footprint(), gust())
    again = read_again(body, seen, PERIOD_S, settings(at_rest=True), begun, modal, camera=camera(), refined=True)
    assert again is not None
    true = net_force(modal, replace(begun, footprint=AT_TIP, force=pushed))
    assert np.linalg.norm(net_force(modal, again) - true) < 0.25 * np.linalg.norm(true)
    np.testing.assert_allclose(again.young, YOUNG, rtol=0.03)


def test_a_wind_that_was_taken_for_a_push_is_found_to_be_one(body: Body, modal: ModalModel) -> None:
    begun = started(body, modal, PUSHED, gust())
    again = read_again(body, seen_under(modal, Footprint(), gust()), PERIOD_S, settings(at_rest=True), begun, modal, camera=camera(), refined=False)
    assert again is not None
    assert again.footprint.family == "uniform"


@pytest.mark.parametrize("footprint", [Footprint(), PUSHED], ids=["wind", "push"])
def test_what_was_right_is_not_read_anew(body: Body, modal: ModalModel, footprint: Footprint) -> None:
    begun = started(body, modal, footprint, gust())
    seen = seen_under(modal, footprint, gust() * (1 if footprint.family == "uniform" else PUSH))
    assert read_again(body, seen, PERIOD_S, settings(at_rest=True), begun, modal, camera=camera(), refined=True) is None
