"""Claims about the nodes as managed nodes, driven through the services of a lifecycle manager."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, fields, messages
from diffphys_ros.nodes.clip_topics import clip_messages, slot_stamps
from diffphys_ros.nodes.convert import message_class, to_ros
from diffphys_ros.nodes.fit_node import FitNode, Published
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.inspect_node import InspectNode
from diffphys_ros.nodes.qos import profile
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode

from .processes import PATIENCE_S

STEPS = {
    "configure": (Transition.TRANSITION_CONFIGURE, "inactive"),
    "activate": (Transition.TRANSITION_ACTIVATE, "active"),
    "deactivate": (Transition.TRANSITION_DEACTIVATE, "inactive"),
    "cleanup": (Transition.TRANSITION_CLEANUP, "unconfigured"),
}
QUICK_S = 0.5  # of a transition; managers wait for seconds


class Manager:
    """Drives a node through its services, as nav2's lifecycle manager does, and subscribes to it."""

    def __init__(self, node) -> None:
        self.node, self.me, self.heard = node, rclpy.create_node("manager"), {}
        self.executor = SingleThreadedExecutor()
        for each in (node, self.me):
            self.executor.add_node(each)
        self.clients = {
            name: self.me.create_client(kind, f"/{node.get_name()}/{name}") for name, kind in (("change_state", ChangeState), ("get_state", GetState))
        }
        self.until(lambda: all(client.service_is_ready() for client in self.clients.values()))

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.02)

    def call(self, client, request):
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def state(self) -> str:
        return self.call(self.clients["get_state"], GetState.Request()).current_state.label

    def drive(self, *steps: str) -> None:
        for step in steps:
            number, wanted = STEPS[step]
            assert self.change(number), step
            assert self.state() == wanted

    def change(self, number: int) -> bool:
        return self.call(self.clients["change_state"], ChangeState.Request(transition=Transition(id=number))).success

    def trigger(self, service: str):
        client = self.me.create_client(Trigger, f"/{self.node.get_name()}/{service}")
        self.until(client.service_is_ready)
        return self.call(client, Trigger.Request())

    def listen(self, name: str) -> list:
        topic, kept = TOPICS[name], []
        self.me.create_subscription(message_class(topic.type_name), name.replace("~", f"/{self.node.get_name()}"), kept.append, profile(topic))
        return kept


@pytest.fixture
def manage(make_node):
    made = []

    def make(cls, **parameters) -> Manager:
        made.append(Manager(make_node(cls, **{"autostart": "false", **parameters})))
        return made[-1]

    yield make
    for each in made:
        each.executor.shutdown()
        each.me.destroy_node()


def inputs(node) -> set[str]:
    return {s.topic_name for s in node.subscriptions} - {"/parameter_events", "/clock"}


NODES = [IngestNode, SegmentNode, SplatNode, FitNode, *([InspectNode] if find_spec("rerun") else [])]


@pytest.mark.parametrize("cls", NODES)
def test_a_manager_runs_a_node_through_all_its_states_twice(manage, cls, tmp_path):
    m = manage(cls, **({"file": tmp_path / "all.rrd"} if cls is InspectNode else {}))
    health = m.listen("/diagnostics")
    assert m.state() == "unconfigured"
    assert not inputs(m.node)
    before = {s.srv_name for s in m.node.services}
    for _ in range(2):
        m.drive("configure")
        assert not inputs(m.node)
        m.drive("activate")
        assert inputs(m.node)
        m.drive("deactivate")
        assert not inputs(m.node)
        m.drive("activate", "deactivate", "cleanup")
        assert {s.srv_name for s in m.node.services} == before
    m.until(lambda: health and messages.values_of(health[-1].status[0])["lifecycle"] == "unconfigured")
    assert m.node.net.faults == 0


def test_by_itself_a_node_is_active_when_it_is_made(make_node):
    node = make_node(SegmentNode)
    assert node.lifecycle == "active"
    assert inputs(node)


def test_by_itself_a_node_that_meets_a_fault_of_the_program_ends_with_that_fault(make_node, monkeypatch):
    def broken(node: object) -> None:
        raise RuntimeError("a bug")

    monkeypatch.setattr(IngestNode, "configure", broken)
    with pytest.raises(RuntimeError, match="a bug"):
        make_node(IngestNode)


def test_a_transition_is_quick(manage):
    m = manage(FitNode)
    for step in ("configure", "activate", "deactivate", "cleanup"):
        began = time.monotonic()
        m.drive(step)
        assert time.monotonic() - began < QUICK_S * 4  # two services, on a busy machine


def test_what_is_latched_survives_deactivation_and_is_gone_after_cleanup(manage, made_recovery, made_clip):
    m = manage(FitNode)
    m.drive("configure", "activate")
    m.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    m.drive("deactivate")
    late = m.listen("~/force_field")
    m.until(lambda: len(late) == 1)
    played = m.listen("~/net_force")
    assert not m.trigger("fit").success
    assert "activate" in m.trigger("fit").message
    assert len(played) <= 1  # the first frame is latched, nothing is played
    m.drive("cleanup", "configure", "activate")
    later = m.listen("~/force_field")
    m.trigger("reset")
    assert not later
    assert m.node.playback is None


def test_a_clip_is_taken_up_again_after_a_pause(manage, made_clip):
    m = manage(SegmentNode)
    m.drive("configure", "activate")
    said = [(topic, to_ros(TOPICS[topic].type_name, plain)) for topic, plain in clip_messages(made_clip, slot_stamps(made_clip))]
    outputs = {topic: m.me.create_publisher(message_class(TOPICS[topic].type_name), topic, profile(TOPICS[topic])) for topic in dict(said)}
    for topic, message in said[: len(said) // 2]:
        outputs[topic].publish(message)
    m.until(lambda: len(m.node.buffer.images) > 2)
    m.drive("deactivate")
    for topic, message in said[len(said) // 2 :]:
        outputs[topic].publish(message)
    assert m.node.waiting_for() == ""
    m.drive("activate")
    m.until(lambda: m.node.complete)
    assert len(m.node.buffer.images) == len(made_clip)


def test_a_fit_ends_with_deactivation(manage, half_sample):
    m = manage(FitNode, bag=half_sample / "clip.mcap")
    m.drive("configure")
    assert not m.node.worker.busy
    m.drive("activate")
    assert m.node.worker.busy
    m.drive("deactivate")
    m.until(lambda: not m.node.worker.busy)
    assert m.node.state == "cancelled"
    m.drive("activate")
    assert m.node.worker.busy


def test_a_transition_that_meets_bad_input_fails_with_a_sentence_and_can_be_tried_again(manage, half_sample, tmp_path, capfd):
    bag = Path(tmp_path / "clip.mcap")
    bag.symlink_to(half_sample / "clip.mcap")
    m = manage(FitNode, bag=bag)
    m.drive("configure")
    bag.unlink()
    assert not m.change(Transition.TRANSITION_ACTIVATE)
    assert m.state() == "inactive"
    assert f"{bag}: there is no such file" in capfd.readouterr().err
    bag.symlink_to(half_sample / "clip.mcap")
    m.drive("activate")
    assert m.node.worker.busy


def test_a_node_that_is_shut_down_is_finalized(manage):
    m = manage(SegmentNode)
    m.drive("configure", "activate")
    assert m.change(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert m.state() == "finalized"
    assert not inputs(m.node)
