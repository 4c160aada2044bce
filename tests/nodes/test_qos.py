"""Claims about QoS that a user overrides, and about the middleware's profile, in real nodes."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy
from sensor_msgs.msg import Image

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.middleware import PROFILE, VARIABLE
from diffphys_ros.nodes.qos import sensor
from diffphys_ros.nodes.segment_node import SegmentNode

from .processes import PATIENCE_S, ROOT


def offered(node, topic: str, kind: str):
    """The QoS with which the middleware knows the node's endpoint."""
    find = node.get_subscriptions_info_by_topic if kind == "subscription" else node.get_publishers_info_by_topic
    (info,) = [info for info in find(topic) if info.node_name == node.get_name()]
    return info.qos_profile


def make(make_node, cls, **overrides):
    return make_node(cls, **{f"qos_overrides.{name}": value for name, value in overrides.items()})


def test_a_subscription_takes_the_users_quality_of_service_and_the_others_keep_theirs(make_node):
    node = make(make_node, IngestNode, **{"/image.subscription.reliability": "reliable", "/image.subscription.depth": 3})
    image, depth = offered(node, "/image", "subscription"), offered(node, "/depth", "subscription")
    assert (image.reliability, node.streams["/image"].reliable) == (ReliabilityPolicy.RELIABLE, True)
    assert (depth.reliability, node.streams["/depth"].reliable) == (ReliabilityPolicy.BEST_EFFORT, False)
    assert node.get_parameter("qos_overrides./depth.subscription.reliability").value == "best_effort"


def test_a_publisher_takes_it_too_and_keeps_it_when_it_is_made_again(make_node):
    node = make(make_node, FitNode, **{"/fit_node/progress.publisher.durability": "volatile"})
    for _ in range(2):
        assert offered(node, "/fit_node/progress", "publisher").durability == DurabilityPolicy.VOLATILE
        assert offered(node, "/fit_node/quality", "publisher").durability == DurabilityPolicy.TRANSIENT_LOCAL
        node.advertise("~/progress")


def test_every_topic_of_a_node_can_be_overridden(make_node):
    node = make_node(SegmentNode)
    names = {name.rpartition(".")[0] for name in node.list_parameters(["qos_overrides"], 0).names}
    wanted = {f"qos_overrides.{node.resolve_topic_name(name)}.subscription" for name in TOPICS if name.startswith("clip/") and name not in ("clip/mask", "clip/done")}
    wanted |= {f"qos_overrides./{name}.subscription" for name in ("click", "first_mask", "clamp_click", "length_click")}
    assert names == wanted | {f"qos_overrides./{name}.publisher" for name in ("clip/mask", "clip/done", "diagnostics")}
    assert offered(node, "/clip/image", "subscription").history in (HistoryPolicy.KEEP_ALL, HistoryPolicy.UNKNOWN)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("/image.subscription.reliability", "perfect", "must be reliable or best_effort"),
        ("/image.subscription.reliability", 3, "must be reliable or best_effort"),
        ("/image.subscription.depth", -1, "must be a whole number"),
        ("/image.subscription.relibility", "reliable", r"must end with \.history, \.depth"),
    ],
)
def test_an_override_that_cannot_be_is_refused_by_name(make_node, name, value, words):
    with pytest.raises(InputError, match=f"qos_overrides.{name}.*{words}"):
        make(make_node, IngestNode, **{name: value})


def test_an_override_of_no_topic_is_said(make_node, capfd):
    make(make_node, IngestNode, **{"/imge.subscription.reliability": "reliable"})
    said = capfd.readouterr().err
    assert "qos_overrides./imge.subscription.reliability changes nothing: the node has no such topic; it has " in said
    assert "/image.subscription" in said


@pytest.mark.parametrize(
    ("given", "wanted"), [({}, str(PROFILE)), ({VARIABLE: "/mine.xml"}, "/mine.xml"), ({"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}, "None")]
)
def test_a_node_takes_the_middlewares_profile_before_rclpy_starts_unless_the_user_has_one(given, wanted):
    code = (
        "import os, sys; from diffphys_ros.nodes import executables as e;"
        f"e._init = lambda rclpy: (print(os.environ.get('{VARIABLE}'), flush=True), os._exit(0)); e.segment_node()"
    )
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE} | given | {"PYTHONPATH": str(ROOT)}
    said = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
    assert said.strip() == wanted


@pytest.fixture
def driven(make_node):
    """Makes an ingest_node beside a driver that publishes images, and spins both."""
    made = []

    def make(offers: str, **parameters):
        node, other = make_node(IngestNode, **parameters), rclpy.create_node("camera")
        health: list[DiagnosticArray] = []
        other.create_subscription(DiagnosticArray, "/diagnostics", health.append, 10)
        output, executor = other.create_publisher(Image, "image", sensor(offers)), SingleThreadedExecutor()
        for each in (node, other):
            executor.add_node(each)
        made.append((executor, other))

        def until(condition) -> float:
            began = time.monotonic()
            while not condition():
                assert time.monotonic() - began < PATIENCE_S
                executor.spin_once(timeout_sec=0.05)
            return time.monotonic() - began

        return node, other, output, health, until

    yield make
    for executor, other in made:
        executor.shutdown()
        other.destroy_node()


def warned(health: list[DiagnosticArray]) -> bool:
    return bool(health) and health[-1].status[0].level == bytes([messages.WARN])


def test_what_is_lost_on_the_way_is_a_warning_in_diagnostics_within_two_seconds(driven, capfd):
    node, _, output, health, until = driven("best_effort")
    until(output.get_subscription_count)
    node.streams["/image"].lose(5)  # what the middleware would call; that it does is for benchmarks/transport.py, where images are large
    image = Image(height=4, width=4, encoding="rgb8", step=12, data=bytes(48))
    for k in range(5):
        image.header.stamp.nanosec = k * 33_000_000
        output.publish(image)
    health.clear()
    assert until(lambda: warned(health) and "lost" in health[-1].status[0].message) < 2.0
    assert "/image: 5 of 10 messages of the last 3 s were lost" in health[-1].status[0].message
    assert messages.values_of(health[-1].status[0])["lost"] == "5"
    said = capfd.readouterr().err
    assert "[WARN]" in said
    assert f"start the driver with {VARIABLE}={PROFILE}" in said


def test_a_stage_that_nobody_has_used_yet_says_so_once_a_minute_and_warns_of_nothing(make_node, capfd):
    node = make_node(SegmentNode)
    node._quiet_since -= 10.0
    for _ in range(3):
        node._said = {said: until - 10.0 for said, until in node._said.items()}  # as if so much time had passed
        node._diagnose()
    said = capfd.readouterr().err
    assert said.count("[INFO]") == said.count("no data for 10 s; waiting for /clip/image (no publisher)") == 1
    node.note_input()  # a part of a clip is there
    node._quiet_since -= 10.0
    node._said.clear()
    node._diagnose()
    assert "[WARN]" in capfd.readouterr().err


def test_depth_that_is_published_and_does_not_come_is_a_warning_within_two_seconds(driven):
    node, other, output, health, until = driven("best_effort")
    other.create_publisher(Image, "depth", sensor("best_effort"))
    until(lambda: output.get_subscription_count() and node.count_publishers("/depth"))
    image, sent = Image(height=4, width=4, encoding="rgb8", step=12, data=bytes(48)), []

    def warns_of_depth() -> bool:
        image.header.stamp.nanosec = len(sent) * 20_000_000 % 10**9
        image.header.stamp.sec = len(sent) // 50
        sent.append(output.publish(image))
        return warned(health) and "/depth: no message yet, though it has a publisher" in health[-1].status[0].message

    assert until(warns_of_depth) < 2.0


def test_a_publisher_with_another_quality_of_service_is_a_warning_with_the_cure(driven):
    node, other, output, health, until = driven("best_effort", reliability="reliable")
    until(lambda: warned(health) and "/image: a publisher offers another reliability than is wanted" in health[-1].status[0].message)
    assert "set reliability:=best_effort (qos_overrides./image.subscription.reliability)" in health[-1].status[0].message
    other.destroy_publisher(output)
    until(lambda: not node.count_publishers("/image"))
    until(lambda: "offers another" not in health[-1].status[0].message)


def test_what_is_waited_for_is_said_with_resolved_topics_and_how_many_publish_there(driven, capfd):
    node, _, output, health, until = driven("best_effort")
    until(output.get_subscription_count)
    health.clear()
    assert until(lambda: warned(health)) < 3.0
    assert "waiting for /image (1 publisher) or /image/compressed (no publisher)" in health[-1].status[0].message
    assert "waiting for /image (1 publisher)" in capfd.readouterr().err
    assert node.state == "waiting"
