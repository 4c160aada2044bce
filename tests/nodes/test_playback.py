"""Claims about playing a recovery, in this process."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, fields
from diffphys_ros.msg_schemas.topics import PLAYED
from diffphys_ros.nodes.convert import message_class
from diffphys_ros.nodes.playback import Playback
from diffphys_ros.nodes.qos import profile
from diffphys_ros.nodes.stage import StageNode

from .processes import PATIENCE_S


class Sending(StageNode):
    """A node that notes what it sends."""

    def __init__(self) -> None:
        self.sent: list[str] = []
        self.playback: Playback | None = None
        super().__init__("fit_node", publishes=PLAYED)

    def _poll(self) -> None:
        super()._poll()
        if self.playback is not None:
            self.playback.look()

    def send(self, name, message) -> None:
        if name in PLAYED:
            self.sent.append(name)
        super().send(name, message)


@pytest.fixture
def spun(make_node):
    node, me, executor = make_node(Sending), rclpy.create_node("robot"), SingleThreadedExecutor()
    for each in (node, me):
        executor.add_node(each)

    def until(condition) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.02)

    def listen(name: str) -> list:
        heard: list = []
        me.create_subscription(message_class(TOPICS[name].type_name), name.replace("~", "/fit_node"), heard.append, profile(TOPICS[name]))
        return heard

    yield node, until, listen
    executor.shutdown()
    me.destroy_node()


def test_nobody_is_played_to_but_the_first_frame_is_latched(spun, made_recovery, made_clip):
    node, until, listen = spun
    node.playback = Playback(node, fields.answer(made_recovery, made_clip, config.Settings()), config.Playback(rate=20.0))
    end = time.monotonic() + 0.5
    until(lambda: time.monotonic() > end)
    assert sorted(node.sent) == sorted(PLAYED)
    heard = listen("~/rendered")
    until(lambda: heard)


def test_who_subscribes_to_one_topic_is_played_that_one(spun, made_recovery, made_clip):
    node, until, listen = spun
    heard = listen("~/net_force")
    until(lambda: node.heard("~/net_force"))
    node.playback = Playback(node, fields.answer(made_recovery, made_clip, config.Settings()), config.Playback(rate=5.0))
    until(lambda: len(heard) > len(made_clip))
    assert {name: node.sent.count(name) for name in PLAYED if name != "~/net_force"} == dict.fromkeys(set(PLAYED) - {"~/net_force"}, 1)


def test_where_it_does_not_loop_the_last_frame_of_all_topics_is_latched(spun, made_recovery, made_clip):
    node, until, listen = spun
    answer = fields.answer(replace(made_recovery), made_clip, config.Settings())
    listen("~/rendered")
    node.playback = Playback(node, answer, config.Playback(rate=20.0, loop=False))
    until(lambda: node.sent.count("~/net_force") == 2)  # the first, and the last though nobody hears it
    heard = listen("~/net_force")
    until(lambda: heard)
    stamp = heard[0].header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == answer.stamp_ns(len(answer) - 1)
