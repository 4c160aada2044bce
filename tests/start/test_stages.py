"""The first answer stage by stage, and clips that end before their free motion begins."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from diffphys_ros.config import Settings
from diffphys_ros.damping import Damping
from diffphys_ros.footprints import Footprint
from diffphys_ros.modes import ModalModel
from diffphys_ros.start import joint_values, joint_wanted, start_values, values
from diffphys_ros.start.force import ForceProblem
from diffphys_ros.start.free_tail import LEAST_YOUNG, MOST_YOUNG, Physics, Tail
from diffphys_ros.start.stages import NEAR_BEST, Fit, Stage, active, first_explained, run
from diffphys_ros.types import Body, StartValues, Tracks
from diffphys_ros.vibration.forced_frames import LEAST_TAIL_FRAMES, Support
from tests.made_bar import FORCED, PERIOD_S, YOUNG, bar, camera, gust, modes_of, motion, settings, tracks

AT_REST = settings(at_rest=True)


@pytest.fixture(scope="module")
def body() -> Body:
    return bar()


@pytest.fixture(scope="module")
def truth(body) -> ModalModel:
    return modes_of(body, YOUNG, finer=0.85, count=12)


def first(seen: Tracks, frames: int) -> Tracks:
    return replace(seen, pixels=seen.pixels[:frames], points=seen.points[:frames], valid=seen.valid[:frames])


def found_jointly(body: Body, seen: Tracks, told: Settings) -> tuple[StartValues, StartValues]:
    """What the first answer guesses, and what it makes of that."""
    guess, modal = start_values(body, seen, PERIOD_S, told)
    return guess, joint_values(body, seen, PERIOD_S, told, guess, modal, camera=camera())


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    return float((a * b).sum() / np.linalg.norm(a) / np.linalg.norm(b))


def test_a_stage_changes_what_it_says_is_free_and_nothing_else() -> None:
    before = Fit(None, None, None, None)  # type: ignore[arg-type]
    stage = Stage("force", "all frames", ("force",), lambda fit: replace(fit, force=np.ones((2, 3)), footprint=Footprint("gaussian", np.ones(3)), grown=True))
    after = run([stage], before)
    assert after.force is not None
    assert replace(after, force=None) == before


@pytest.mark.parametrize(("schedule", "free_tail", "wanted"), [("auto", True, False), ("auto", False, True), ("joint", True, True), ("modes", False, False)])
def test_force_and_stiffness_are_found_together_where_asked_for_or_where_no_free_tail_tells(schedule: str, free_tail: bool, wanted: bool) -> None:
    asked = replace(AT_REST, experiment=replace(AT_REST.experiment, schedule=schedule))
    assert joint_wanted(SimpleNamespace(has_free_tail=free_tail), asked) is wanted  # type: ignore[arg-type]


def test_frames_before_and_after_a_gust_carry_a_force_and_a_zero_crossing_is_bridged() -> None:
    size = np.array([0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0.1])
    forced = Support(active(size), False, np.zeros(0), np.zeros(0), 0.0)
    np.testing.assert_array_equal(np.flatnonzero(forced.allowed), np.arange(1, 9))


@pytest.mark.slow
@pytest.mark.parametrize(("free", "within", "claimed"), [(2, 0.12, False), (10, 0.015, True)])
def test_a_clip_that_ends_soon_after_the_force_tells_its_stiffness_and_claims_it_only_with_frames_without_force(
    body, truth, free: int, within: float, claimed: bool
) -> None:
    seen = first(tracks(truth, motion(truth, YOUNG, gust())), FORCED.stop + free)
    guess, found = found_jointly(body, seen, AT_REST)
    assert not guess.has_free_tail
    assert np.abs(np.log10(guess.young / YOUNG)).max() > within
    assert np.abs(np.log10(found.young / YOUNG)).max() < within
    assert found.identified.all() == found.identified.any() == claimed
    assert cosine(found.force, gust()[: len(found.force)]) > 0.95


@pytest.mark.slow
def test_a_clip_that_starts_in_motion_has_that_motion_found_beside_force_and_stiffness(body, truth) -> None:
    begun = np.zeros((2, truth.modes))
    begun[0, :2], begun[1, :2] = (2.5e-3, -1e-3), (0.02, 0.03)
    q = motion(truth, YOUNG, gust(), initial_displacement=begun[0], initial_velocity=begun[1])
    _, found = found_jointly(body, first(tracks(truth, q), FORCED.stop + 8), settings(at_rest=False))
    assert np.abs(np.log10(found.young / YOUNG)).max() < 0.03
    assert found.track_cost < 1e-3


@pytest.mark.parametrize("explained", [{6}, {10}, {4, 6}, {2, 4, 6, 8, 10}])
def test_the_longest_tail_that_is_explained_is_looked_for_where_its_half_or_its_end_is(explained: set[int]) -> None:
    shares = {by: 0.1 if by in explained else 0.4 for by in range(2, 11, 2)}
    assert first_explained(shares.__getitem__, range(2, 11, 2), 0.2) == min(explained)


def test_of_tails_that_are_explained_nearly_alike_the_longest_is_taken() -> None:
    shares = {2: 0.4, 4: 0.1, 6: 0.1, 8: 0.1, 10: 1.1 * 0.1 / NEAR_BEST}
    assert first_explained(shares.__getitem__, list(shares), 0.2) == 4
    shares[10] = 0.9 * 0.1 / NEAR_BEST
    assert first_explained(shares.__getitem__, list(shares), 0.2) == 10


def test_where_neither_half_nor_end_is_explained_no_other_tail_is_tried() -> None:
    tried: list[int] = []
    assert first_explained(lambda by: tried.append(by) or 0.4, range(2, 11, 2), 0.2) is None
    assert sorted(tried) == [6, 10]
    assert first_explained(lambda by: 0.0, range(2, 2), 0.2) is None


@pytest.mark.slow
def test_a_second_gust_that_was_read_as_free_motion_is_found_where_the_modes_do_not_explain_it(body, truth, monkeypatch) -> None:
    """Noise and lost frames hide it from what reads forced frames from the motion alone."""
    second = FORCED.stop - FORCED.start + 6
    force = gust() + 0.8 * np.roll(gust(), second, 0)[:, [0, 2, 1]]
    seen = tracks(truth, motion(truth, YOUNG, force))
    whole = values.find_support

    def blind(*words, **told) -> Support:
        support = whole(*words, **told)
        forced = support.forced.copy()
        forced[FORCED.stop :] = False
        return replace(support, forced=forced, has_free_tail=True)

    monkeypatch.setattr(values, "find_support", blind)
    monkeypatch.setattr(ForceProblem, "edges", lambda *_: (0, 0))  # which would find it as well, frame by frame
    found = start_values(body, seen, PERIOD_S, AT_REST)[0]
    assert found.forced[FORCED.start + second : FORCED.stop + second].all()
    assert np.abs(np.log10(found.young / YOUNG)).max() < 0.03
    assert found.identified.all()


@pytest.mark.slow
def test_a_tail_is_left_however_many_frames_a_wrong_physics_finds_forced(body, truth, monkeypatch) -> None:
    seen = tracks(truth, motion(truth, YOUNG, gust()))
    monkeypatch.setattr(ForceProblem, "edges", lambda *_: (0, 1000))
    found = start_values(body, seen, PERIOD_S, AT_REST)[0]
    assert (~found.forced).sum() >= LEAST_TAIL_FRAMES


def test_no_search_goes_beyond_what_a_solid_can_be() -> None:
    stiff, soft = (Physics(np.array([young]), Damping(0.0, 0.0), np.zeros(0)) for young in (5e12, 20.0))
    assert np.exp(stiff.bounds()[1][0]) == pytest.approx(MOST_YOUNG)
    assert np.exp(soft.bounds()[0][0]) == pytest.approx(LEAST_YOUNG)
    for young in (1e-9, 5e12, 1e20):
        low, high = replace(stiff, young=np.array([young])).bounds()
        assert low[0] < high[0]


def test_a_drift_that_nothing_holds_is_no_leading_oscillation() -> None:
    """All of the motion but a tenth is a shift; scaling the modulus until a shift swings would go on for ever."""
    modal = SimpleNamespace(eigen=lambda young: (np.array([1e-9, young[0]]), np.eye(2)))
    data = np.column_stack([np.full(30, 0.9), 0.1 * np.cos(np.arange(30))])
    seen = SimpleNamespace(data=data, operator=np.eye(2))
    tail = Tail(modal, seen, 0, PERIOD_S, np.ones(30, bool), False, 1e-4, 2)  # type: ignore[arg-type]
    assert tail.leading_mode(np.array([1e5])) == 1
    np.testing.assert_allclose(tail.matched(np.array([1e5]), 2.0), (4 * np.pi) ** 2)
