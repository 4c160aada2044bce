"""Claims about clips on their way out: one at a time, two wait, others are dropped and counted."""

from __future__ import annotations

from diffphys_ros.msg_schemas.messages import ERROR, OK, WARN
from diffphys_ros.nodes.dispatch import Dispatch
from diffphys_ros.nodes.intake import Intake

STAGES = ("/segment_node", "/splat_node", "/fit_node")


def clip() -> Intake:
    return Intake(10, 10)


def out() -> Dispatch:
    """One clip is with the stages, another waits."""
    dispatch = Dispatch()
    dispatch.add(clip())
    dispatch.next(STAGES)
    dispatch.sent(1)
    dispatch.add(clip())
    return dispatch


def test_the_next_clip_goes_when_every_stage_has_ended_with_the_one_before() -> None:
    dispatch = out()
    for stage in STAGES:
        assert dispatch.next(STAGES) is None
        assert stage in dispatch.held_up_by(STAGES)
        dispatch.hear(stage, 1, OK)
    assert dispatch.next(STAGES) is not None


def test_what_a_stage_says_of_another_clip_does_not_count() -> None:
    dispatch = out()
    for stage in STAGES:
        dispatch.hear(stage, 7, OK)
    dispatch.hear("/segment_node", 7, ERROR)
    assert dispatch.next(STAGES) is None


def test_a_stage_that_fails_or_forgets_lets_the_next_one_pass() -> None:
    for level in (ERROR, WARN):
        dispatch = out()
        dispatch.hear("/segment_node", 1, level)
        assert dispatch.next(STAGES) is not None


def test_a_stage_that_is_gone_is_not_waited_for() -> None:
    dispatch = out()
    dispatch.hear("/segment_node", 1, OK)
    assert dispatch.next(["/segment_node", "/fit_node"]) is None
    assert dispatch.next(["/segment_node"]) is not None


def test_a_third_clip_is_dropped_and_counted() -> None:
    dispatch = out()
    assert [dispatch.add(clip()) for _ in range(4)] == [True, False, False, False]
    assert dispatch.dropped == 3
    assert dispatch.release() == 2
