"""The free tail that a joint fit uncovers, where the motion alone did not show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diffphys_ros.damping import Damping
from diffphys_ros.modes import ModalModel
from diffphys_ros.start import freed_values, joint_values, start_values
from diffphys_ros.start.freed import FREED_SD
from diffphys_ros.types import Body, StartValues, Tracks
from tests.made_bar import BETA, FORCED, FRAMES, PERIOD_S, SMALL, blade, camera, modes_of, push_on_its_corner, settings, tracks

YOUNG = np.array([1.2e6, 2.4e6])  # Pa
RUBBER = 0.42
TOLD = settings(at_rest=True)


def seen(frames: range) -> Tracks:
    """Of a blade of rubber on whose corner a force that changes acts in some frames."""
    truth = modes_of(blade(RUBBER), YOUNG, count=12)
    push = np.zeros((FRAMES, 3))
    push[frames.start : frames.stop] = SMALL * np.outer(1 + 0.4 * np.sin(2.1 * np.arange(len(frames))), (0.0, 2500.0, 2000.0))
    load = push_on_its_corner(truth, push)
    return tracks(truth, truth.respond(YOUNG, damping=Damping(0.0, BETA), load=load, period_s=PERIOD_S))


def jointly(body: Body, motion: Tracks) -> tuple[StartValues, ModalModel]:
    """Stiffness and force together, whatever the motion shows of a free tail."""
    start, modal = start_values(body, motion, PERIOD_S, TOLD)
    return joint_values(body, motion, PERIOD_S, TOLD, replace(start, has_free_tail=False), modal, camera=camera()), modal


@pytest.fixture(scope="module")
def joint() -> tuple[StartValues, ModalModel]:
    """Of a force that ends in the middle of the clip."""
    return jointly(blade(0.3), seen(range(FORCED.start, FORCED.stop)))


@pytest.mark.slow
@pytest.mark.parametrize(("share", "free"), [(0.15, True), (0.6, False)])
def test_a_faint_force_at_the_end_of_a_joint_fit_hides_no_free_tail_and_a_strong_one_does(joint: tuple[StartValues, ModalModel], share: float, free: bool) -> None:
    """A large swing that the modes miss in part leaves faint forces here and there: after the last of them too few frames were left."""
    start, modal = joint
    forced, force = start.forced.copy(), start.force.copy()
    last = slice(FRAMES - 8, FRAMES - 4)
    forced[last] = True
    force[last] = share * np.linalg.norm(force, axis=1).max() * np.array([0.0, 0.0, 1.0])
    freed = freed_values(blade(0.3), seen(range(FORCED.start, FORCED.stop)), PERIOD_S, TOLD, replace(start, forced=forced, force=force), modal, camera=camera())
    assert (freed is not None) == free
    if freed is not None:
        assert np.abs(np.log10(freed[0].young / YOUNG)).max() < 0.03
        assert not freed[0].forced[last].any()


@pytest.mark.slow
def test_the_free_frames_that_a_joint_fit_uncovers_tell_what_it_took_for_stiffness(joint: tuple[StartValues, ModalModel]) -> None:
    """Of three tees of sixteen two modes beat, so that no free tail was seen: E of their branches was off by .39 to .65 at a stated .02 to .1."""
    body, motion = blade(0.3), seen(range(FORCED.start, FORCED.stop))
    start, modal = joint
    assert start.identified.all()
    freed = freed_values(body, motion, PERIOD_S, TOLD, start, modal, camera=camera())
    assert freed is not None
    found = freed[0]
    error, before = (np.abs(np.log10(each.young / YOUNG)) for each in (found, start))
    assert found.has_free_tail
    assert error.max() < 0.03
    assert error.max() < 0.5 * before.max()
    assert (found.log10_young_sd > FREED_SD).all()
    assert abs(found.poisson[0] - RUBBER) < 0.05


@pytest.mark.slow
def test_a_force_that_acts_to_the_end_leaves_nothing_free() -> None:
    body, motion = blade(0.3), seen(range(FORCED.start, FRAMES))
    start, modal = jointly(body, motion)
    for each in (start, replace(start, identified=np.ones(2, bool))):
        assert freed_values(body, motion, PERIOD_S, TOLD, each, modal, camera=camera()) is None
