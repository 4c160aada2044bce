"""The force of both clips in newtons and in the world frame: in the file, and on the topics that a robot receives.

Where it comes from: a frame's force is what is left of the tracks' second difference, whose noise stands against a peak of 5 to 7 N; the
swing of the frame before and after is tied to it. Other sides, frames a step apart and the body's frame are off by the peak itself.
"""

from __future__ import annotations

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages

from diffphys_ros import result
from diffphys_ros.msg_schemas import clouds

from .conftest import Answer, Recover

EVERY_FRAME = 0.15  # of the true peak, that the force of one forced frame may be off
SIZE = 0.07  # of the whole: recovered force projected on the true one
INSIDE = 0.85  # of components, inside two stated deviations
VAGUEST = 0.6  # of the force, rms: most that its deviations may be, where a wind and a push about the outer half are hardly told apart
TOPICS = 0.001  # of the true peak, by which topics may differ from the file: they are single precision


@pytest.fixture(scope="module", params=["strip", "bar"])
def answer(request: pytest.FixtureRequest, recovered: Recover) -> Answer:
    return recovered(request.param)


def peak(answer: Answer) -> float:
    """Of the true net force [N]."""
    return float(np.linalg.norm(answer.true_net_force, axis=1).max())


def errors(answer: Answer, force: np.ndarray) -> np.ndarray:
    """Of a net force (T, 3) in the frames in which the true one acts, over its peak."""
    true = answer.true_net_force
    active = np.linalg.norm(true, axis=1) > 0.01 * peak(answer)
    return np.linalg.norm(force[: len(true)] - true, axis=1)[active] / peak(answer)


def test_the_net_force_is_the_true_one_in_every_forced_frame(answer: Answer) -> None:
    assert float(errors(answer, answer.recovery.net_force()).max()) < EVERY_FRAME


def test_the_net_force_has_the_true_size(answer: Answer) -> None:
    true = answer.true_net_force
    found = answer.recovery.net_force()[: len(true)]
    assert abs((found * true).sum() / (true**2).sum() - 1) < SIZE


def test_the_true_net_force_lies_where_it_is_stated_to_lie_and_that_says_something(answer: Answer) -> None:
    found, sd = answer.recovery.net_force(), answer.recovery.net_force_sd
    true, acting = answer.true_net_force[: len(sd)], (sd > 0).any(1)
    assert (np.abs(found - true)[acting] <= 2 * sd[acting]).mean() > INSIDE
    assert np.sqrt((sd**2).sum() / (true**2).sum()) < VAGUEST
    assert abs(answer.recovery.net_force_peak - peak(answer)) < 2 * answer.recovery.net_force_peak_sd < peak(answer)


def test_topics_carry_the_true_net_force_in_the_world_frame(answer: Answer) -> None:
    messages = [(m.channel.topic, m.ros_msg) for m in read_ros2_messages(answer.folder / result.RECORDING)]
    (cloud,) = (message for topic, message in messages if topic.endswith("force_field"))
    wrenches = [message for topic, message in messages if topic.endswith("net_force")]
    assert {message.header.frame_id for message in (cloud, *wrenches)} == {"world"}
    points = clouds.unpack(cloud)
    summed = np.einsum("tnc,tn->tc", clouds.xyz(points, "f"), points["volume"].astype(float))
    played = np.array([[w.wrench.force.x, w.wrench.force.y, w.wrench.force.z] for w in wrenches])
    for force in (summed, played):
        assert float(errors(answer, force).max()) < EVERY_FRAME
        assert np.abs(force - answer.recovery.net_force()).max() < TOPICS * peak(answer)
