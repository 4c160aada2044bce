"""Claims about what a node does with a callback that fails."""

from __future__ import annotations

import time

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.nodes.clip_checks import check_colour
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.net import MAX_WORDS, Net, sentence_of
from diffphys_ros.nodes.stage import StageNode
from diffphys_ros.nodes.worker import CANCELLED, FAILED, Event

from .processes import PATIENCE_S


class Fragile(StageNode):
    """Fails in every kind of callback."""

    def __init__(self) -> None:
        self.heard, self.ticks = [], 0
        super().__init__("fragile_node")
        self.create_subscription(UInt32, "number", self._on_number, 10)
        self.create_service(Trigger, "~/bad", self._on_bad)
        self.create_timer(0.05, self._on_tick)

    def _on_number(self, message) -> None:
        if message.data == 1:
            raise InputError("number is 1, must be another; send 2")
        if message.data == 3:
            raise ZeroDivisionError("a bug")
        self.heard.append(message.data)

    def _on_bad(self, request, response):
        raise KeyError("forgotten")

    def _on_tick(self) -> None:
        self.ticks += 1
        raise InputError("the timer has no input")

    def on_done(self, result) -> None:
        raise ValueError("a result that cannot be sent")


class Words:
    """A logger that keeps what it is told."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def error(self, words: str) -> None:
        self.said.append(words)


@pytest.fixture
def world(make_node):
    node = make_node(Fragile)
    other, executor = rclpy.create_node("other"), SingleThreadedExecutor()
    for each in (node, other):
        executor.add_node(each)

    def until(condition) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.05)

    yield node, other, until
    executor.shutdown()
    other.destroy_node()


def test_a_callback_that_fails_costs_its_message_alone_and_diagnostics_say_so(world) -> None:
    node, other, until = world
    health: list[DiagnosticArray] = []
    other.create_subscription(DiagnosticArray, "/diagnostics", health.append, 10)
    numbers = other.create_publisher(UInt32, "number", 10)
    until(numbers.get_subscription_count)
    for number in (1, 2):
        numbers.publish(UInt32(data=number))
    until(lambda: node.heard == [2])
    until(lambda: health and health[-1].status[0].level == bytes([messages.WARN]))
    for number in (3, 4):
        numbers.publish(UInt32(data=number))
    until(lambda: node.heard == [2, 4])
    until(lambda: health[-1].status[0].level == bytes([messages.ERROR]))
    values = messages.values_of(health[-1].status[0])
    assert (int(values["refused"]) >= 1, values["faults"]) == (True, "1")
    assert values["last_error"] == "/number: error of the program: ZeroDivisionError: a bug"


def test_a_timer_that_fails_ticks_on(world) -> None:
    node, _, until = world
    until(lambda: node.ticks > 5)


def test_a_service_that_fails_answers(world) -> None:
    _node, other, until = world
    client = other.create_client(Trigger, "/fragile_node/bad")
    until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    until(future.done)
    assert not future.result().success
    assert "KeyError" in future.result().message


def test_a_result_that_cannot_be_published_is_a_failure(world) -> None:
    node, _, until = world
    node.worker.start(lambda: iter(()))
    until(lambda: node.state == "failed")
    assert node.worker.start(lambda: iter(()))


@pytest.mark.parametrize("states", [(FAILED, CANCELLED), (CANCELLED, FAILED)])
def test_a_job_that_fails_and_one_that_is_cancelled_are_said_by_the_same_node(make_node, capfd, states) -> None:
    node, idle = make_node(FitNode), []
    node.on_idle = lambda: idle.append(node.state)
    for kind in states:
        node._handle(Event(kind, InputError("the clip is too short; record a longer one")))
    assert idle == list(states)
    said = capfd.readouterr().err
    assert said.count("[ERROR]") == said.count("the clip is too short") == 1
    assert said.count("[INFO]") == said.count("cancelled; ~/fit begins again") == 1


def test_a_renamed_fit_node_signs_what_it_says_with_its_name(make_node) -> None:
    node, sent = make_node(FitNode, "-r", "__node:=finder"), []
    node.send = lambda name, fields: sent.append((name, fields))
    node._say(stage="fit", iteration=1)
    for kind in (FAILED, CANCELLED):
        node._handle(Event(kind, InputError("the clip is too short; record a longer one")))
    node._diagnose()
    assert {name for name, _ in sent} == {"~/progress", "~/quality", "/diagnostics"}
    assert {status["name"].partition(": ")[0] for _, fields in sent for status in fields["status"]} == {"finder"}


def test_a_flood_of_bad_messages_is_no_flood_of_words() -> None:
    words = Words()
    net = Net(lambda: words)
    for k in range(10_000):
        net.catch(InputError(f"number {k} is bad"), "number")
        net.catch(InputError(f"depth {k} is bad"), "depth")
    assert words.said == ["number 0 is bad", "depth 0 is bad"]
    assert net.refused == 20_000
    assert len(net._said) == 2


def test_an_error_of_the_program_is_logged_with_its_traceback() -> None:
    words = Words()
    net = Net(lambda: words)

    def broken(message) -> None:
        raise IndexError("nothing there")

    net.around(broken, "depth")(UInt32())
    assert "in broken" in words.said[0]
    assert "IndexError: nothing there" in words.said[0]


@pytest.mark.parametrize("change", [{"height": 0}, {"step": 1}, {"data": b""}, {"encoding": "nv21"}, {"height": 2**15, "width": 2**15}])
def test_what_is_said_of_a_live_image_speaks_of_no_recording(change) -> None:
    good = messages.image(messages.header(0), np.zeros((4, 4, 3), np.uint8), "rgb8")
    with pytest.raises(InputError, match="topic image: ") as caught:
        check_colour(to_ros("sensor_msgs/msg/Image", good | change), "image")
    assert "record" not in str(caught.value)


def test_a_sentence_is_one_printable_line_of_bounded_length() -> None:
    sentence = sentence_of(InputError("a\nb\0" + "x" * 5000))
    assert sentence.isprintable()
    assert len(sentence) == MAX_WORDS
