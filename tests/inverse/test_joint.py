"""Start values without a free tail."""

import dataclasses

import numpy as np

from diffphys_ros.config import build
from diffphys_ros.start import joint_values
from diffphys_ros.start.stages import active
from diffphys_ros.vibration.forced_frames import Support

from .conftest import FRAMES, PERIOD_S, YOUNG, make_camera, make_tracks

AT_REST = build({"scene.at_rest": True})


def test_frames_with_a_force_are_widened_and_short_gaps_bridged():
    force = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1, 0.1, 0, 0])
    forced = Support(active(force), False, np.zeros(0), np.zeros(0), 0.0)
    np.testing.assert_array_equal(np.flatnonzero(forced.allowed), [2, 3, 4, 5, 6, 7, 8, 9])


def test_stiffness_and_force_are_found_together_from_a_wrong_guess(prepared):
    """The tail of this clip is free but nothing says so: the sparse penalty must find that out."""
    start = dataclasses.replace(
        prepared.start,
        young=np.full(2, 1.6 * YOUNG.mean()),
        forced=np.ones(FRAMES, bool),
        force=np.zeros((FRAMES, 3)),
        has_free_tail=False,
    )
    tracks = make_tracks(prepared.body, prepared.modal, prepared.start)
    found = joint_values(prepared.body, tracks, PERIOD_S, AT_REST, start, prepared.modal, camera=make_camera())
    assert np.abs(np.log10(found.young / YOUNG)).max() < 0.04  # the guess is .11 and .33 off
    assert found.track_cost < 0.01
    true, got = prepared.start.force, found.force
    assert (true * got).sum() / np.sqrt((true**2).sum() * (got**2).sum()) > 0.9
    assert not found.has_free_tail
    assert all("no free tail" in reason for reason in found.reasons)


def test_a_part_whose_stiffness_nothing_tells_ends_with_the_motion_explained_and_a_reason(prepared):
    """The equations for it are singular."""
    modal = dataclasses.replace(prepared.modal, stiffness=prepared.modal.stiffness * np.array([1.0, 0.0])[:, None, None])
    start = dataclasses.replace(prepared.start, forced=np.ones(FRAMES, bool), has_free_tail=False)
    tracks = make_tracks(prepared.body, prepared.modal, prepared.start)
    found = joint_values(prepared.body, tracks, PERIOD_S, AT_REST, start, modal, camera=make_camera())
    assert np.isfinite(found.young).all()
    assert found.track_cost < 0.2
    assert not found.identified[1]
    assert found.log10_young_sd[1] > 0.3
    assert "starts agree within" in found.reasons[1]


def test_tracks_that_never_move_end_in_numbers_and_no_stiffness(prepared):
    tracks = make_tracks(prepared.body, prepared.modal, prepared.start)
    still = dataclasses.replace(tracks, points=np.repeat(tracks.points[:1], FRAMES, 0))
    found = joint_values(prepared.body, still, PERIOD_S, AT_REST, prepared.start, prepared.modal, camera=make_camera())
    assert np.isfinite(found.young).all()
    assert np.isfinite(found.force).all()
    assert not found.identified.any()


def test_a_joint_fit_that_leaves_much_of_the_motion_unexplained_tells_no_stiffness(prepared):
    """Starts that agree on a body which is not the one that moves are no answer."""
    tracks = make_tracks(prepared.body, prepared.modal, prepared.start)
    moved = tracks.points - tracks.points[:1]
    ripple = np.sign(np.sin(40 * np.arange(tracks.points.shape[1])))[:, None] * np.sqrt((moved**2).sum(2).mean())
    strange = dataclasses.replace(tracks, points=tracks.points + 0.4 * ripple * np.sin(0.7 * np.arange(FRAMES))[:, None, None] * np.array([0.0, 1.0, 0.0]))
    found = joint_values(prepared.body, strange, PERIOD_S, AT_REST, prepared.start, prepared.modal, camera=make_camera())
    assert not found.identified.any()
    assert "and the motion differs from the fitted by" in found.reasons[0]
