"""Claims about what a node says of a driver's topics."""

from __future__ import annotations

import numpy as np
import pytest
from std_msgs.msg import Header

from diffphys_ros.nodes.middleware import PROFILE
from diffphys_ros.nodes.streams import Stream, silences


class Stamped:
    """A message with a header alone."""

    def __init__(self, stamp_s: float) -> None:
        self.header = Header()
        self.header.stamp.sec, self.header.stamp.nanosec = int(stamp_s), round(stamp_s % 1 * 1e9)


def heard(stamps_s, *, topic: str = "/camera/image_raw", reliable: bool = False) -> Stream:
    """A stream whose messages come as they are stamped."""
    stream = Stream(topic)
    stream.reliable = reliable
    for stamp in stamps_s:
        stream.hear(Stamped(100 + stamp), now=stamp)
    return stream


def steady(seconds: float = 2.0, rate_hz: float = 30.0) -> list[float]:
    return [k / rate_hz for k in range(int(seconds * rate_hz))]


def texts(stream: Stream, now: float) -> list[tuple[str, str]]:
    return [(doubt.kind, doubt.text) for doubt in stream.doubts(now)]


@pytest.mark.parametrize("rate_hz", [6.0, 30.0, 240.0])
def test_nothing_is_said_of_a_steady_stream(rate_hz):
    assert texts(heard(steady(rate_hz=rate_hz)), 2.0) == []


def test_nothing_is_said_of_a_few_messages():
    assert texts(heard([0.0, 0.5, 1.9]), 2.0) == []


def test_loss_is_said_with_its_topic_and_its_cure_and_forgotten_when_it_is_over():
    stream = heard(steady())
    stream.lose(7, now=1.5)
    ((kind, text),) = texts(stream, 2.0)
    assert kind == "lost"
    assert text.startswith("/camera/image_raw: 7 of 67 messages of the last 3 s were lost on the way; ")
    assert str(PROFILE) in text
    assert "reliability:=reliable" in text
    assert texts(stream, 5.0) == []
    assert stream.lost == 7


def test_gaps_between_the_stamps_are_a_low_rate():
    ((kind, text),) = texts(heard([t for k, t in enumerate(steady()) if k % 10 < 6]), 2.0)
    assert kind == "slow"
    assert "35 of about 55 messages come" in text
    assert "in place of 30.0 Hz" in text


def test_a_rate_that_motion_cannot_be_followed_at_is_said():
    ((_, text),) = texts(heard(steady(3.0, 3.0)), 3.0)
    assert "comes at 3.0 Hz, at least 5 Hz are needed" in text


def test_a_reliable_stream_is_not_told_to_become_reliable():
    stream = heard(steady(), reliable=True)
    stream.lose(1, now=1.0)
    assert "reliability" not in texts(stream, 2.0)[0][1]


def test_of_a_topic_where_a_message_now_and_then_will_do_only_loss_is_said():
    stream = Stream("/mask", sparse=True)
    for k in range(8):
        stream.hear(Stamped(100 + k), now=k / 3)
    assert texts(stream, 2.7) == []
    stream.lose(1, now=2.7)
    assert [kind for kind, _ in texts(stream, 2.7)] == ["lost"]


def test_jitter_is_no_loss():
    late = np.random.default_rng(0).normal(0.0, 0.006, 60)
    assert texts(heard(sorted(t + d for t, d in zip(steady(), late, strict=True))), 2.0) == []


def test_silence_is_said_of_a_topic_that_is_published_while_another_one_comes():
    image, depth, info, mask = heard(steady()), heard([0.0, 0.1], topic="/depth"), Stream("/info"), Stream("/mask", sparse=True)
    both = [image, depth, info, mask]
    assert [doubt.text.split(";")[0] for doubt in silences(both, {"/depth": 1, "/mask": 1, "/info": 1}, 2.0)] == [
        "/depth: no message for 2 s, though it has a publisher",
        "/info: no message yet, though it has a publisher",
    ]
    assert not list(silences(both, {}, 2.0))  # nobody publishes depth: there is none
    assert not list(silences(both, {"/depth": 1}, 9.0))  # all is over


def test_a_slow_topic_is_not_silent_between_its_messages():
    assert not heard([0.0, 2.0, 4.0]).silent(6.5)
    assert heard([0.0, 2.0, 4.0]).silent(11.0)
