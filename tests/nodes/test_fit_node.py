"""Claims about fit_node's services and its answers to bad input, in this process."""

from __future__ import annotations

import json
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.msg_schemas import TOPICS, clouds, fields, messages
from diffphys_ros.nodes.convert import message_class
from diffphys_ros.nodes.fit_node import FitNode, Published
from diffphys_ros.nodes.qos import profile

from .processes import PATIENCE_S


class Robot:
    """A node that subscribes to fit_node and calls its services, spun together with it."""

    def __init__(self, node: FitNode) -> None:
        self.node, self.me, self.heard = node, rclpy.create_node("robot"), {}
        self.executor = SingleThreadedExecutor()
        for each in (node, self.me):
            self.executor.add_node(each)

    def listen(self, name: str) -> None:
        topic, self.heard[name] = TOPICS[name], []
        self.me.create_subscription(message_class(topic.type_name), name.replace("~", "/fit_node"), self.heard[name].append, profile(topic))

    def until(self, condition, timeout_s: float = PATIENCE_S) -> None:
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"state {self.node.state}"
            self.executor.spin_once(timeout_sec=0.05)

    def call(self, service: str):
        client = self.me.create_client(Trigger, f"/fit_node/{service}")
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def progress(self) -> list[dict[str, str]]:
        return [messages.values_of(m.status[0]) for m in self.heard["~/progress"]]

    def stages(self) -> list[str]:
        return [values["stage"] for values in self.progress()]

    def fits(self, iteration: int) -> bool:
        """Whether the fit has told of this iteration."""
        return any(values["stage"] == "fit" and values["iteration"] == str(iteration) for values in self.progress())


@pytest.fixture
def robot(make_node):
    made = []

    def make(**parameters) -> Robot:
        made.append(Robot(make_node(FitNode, **parameters)))
        return made[-1]

    yield make
    for each in made:
        each.executor.shutdown()
        each.me.destroy_node()


def test_a_fit_can_be_cancelled_and_begun_again(robot, half_sample):
    r = robot(bag=half_sample / "clip.mcap", config=half_sample / "given.yaml")
    r.listen("~/progress")
    r.until(lambda: "segment" in r.stages())
    assert not r.call("fit").success  # one runs
    assert r.call("cancel").success
    r.until(lambda: r.node.state == "cancelled")
    r.until(lambda: "cancelled" in r.stages())
    assert not r.call("cancel").success
    assert r.call("fit").success
    r.until(lambda: r.stages().count("segment") == 2)
    assert r.call("reset").success
    r.until(lambda: not r.node.worker.busy)


FEW = {"fit__iterations": 3, "particles__cells": 2, "splats__max_count": 300, "splats__refine_frames": 2}


def test_a_cancelled_fit_goes_on_from_its_checkpoint_and_leaves_none_behind(robot, half_sample, tmp_path):
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text("experiment: {per_cell: 2.0, splat_iterations: 3}")
    files = f"[{half_sample / 'given.yaml'}, {coarse}]"
    bag = {"bag": half_sample / "clip.mcap", "config": files, "out": tmp_path / "out", "resume": True}
    r = robot(**bag, **FEW)
    r.listen("~/progress")
    r.until(lambda: r.fits(1))
    assert r.call("cancel").success
    r.until(lambda: r.node.state == "cancelled")
    assert (tmp_path / "out" / "checkpoint.npz").exists()
    r.heard["~/progress"].clear()
    assert r.call("fit").success
    r.until(lambda: r.node.state == "done")
    assert not r.fits(0)  # the start was not evaluated again
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["iterations"] == 3
    assert len(metrics["loss_history"]) == 4  # with those of the first fit
    assert not (tmp_path / "out" / "checkpoint.npz").exists()


def test_a_recording_that_cannot_be_read_is_said_in_quality_and_the_node_lives_on(robot, tmp_path):
    (tmp_path / "broken.mcap").write_bytes((sample_folder() / "clip.mcap").read_bytes()[:20_000])
    r = robot(bag=tmp_path / "broken.mcap")
    for name in ("~/quality", "~/progress", "/diagnostics"):
        r.listen(name)
    r.until(lambda: r.heard["~/quality"] and r.heard["/diagnostics"] and "failed" in r.stages())
    status = r.heard["~/quality"][-1].status[0]
    assert status.level == bytes([messages.ERROR])
    assert "broken.mcap" in messages.values_of(status)["reason"]
    r.until(lambda: messages.values_of(r.heard["/diagnostics"][-1].status[0])["state"] == "failed")


def test_without_a_bag_the_service_says_what_is_missing(robot):
    response = robot().call("fit")
    assert not response.success
    assert "clip/image" in response.message


def stamp_of(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_results_are_latched_and_the_motion_is_played_at_its_stamps(robot, made_recovery, made_clip):
    r = robot()
    answer = fields.answer(made_recovery, made_clip, config.build({}))
    r.node.on_news(Published(answer))
    for name in ("~/material_field", "~/force_field", "~/quality", "~/state", "~/net_force", "~/force_markers", "~/rendered"):
        r.listen(name)  # late
    stamps = {answer.stamp_ns(k) for k in range(len(answer))}
    # it loops: a history of one may lose a frame on a busy machine, which comes again
    r.until(lambda: {stamp_of(m) for m in r.heard["~/net_force"]} == stamps)
    r.until(lambda: all(r.heard.values()))
    assert [len(r.heard[name]) for name in ("~/material_field", "~/force_field", "~/quality")] == [1, 1, 1]
    assert clouds.unpack(r.heard["~/force_field"][0]).tobytes() == clouds.unpack(answer.force_field()).tobytes()
    by_stamp = {stamp_of(m): m.wrench.force for m in r.heard["~/net_force"]}
    for k in range(len(answer)):
        force = by_stamp[answer.stamp_ns(k)]
        assert [force.x, force.y, force.z] == pytest.approx(answer.wrench(k)[0], abs=1e-9)


def test_playback_ends_with_the_last_frame_where_looping_is_off(robot, made_recovery, made_clip):
    r = robot(playback__loop="false")
    r.listen("~/net_force")
    answer = fields.answer(made_recovery, made_clip, config.build({}))
    r.node.on_news(Published(answer))
    r.until(lambda: r.heard["~/net_force"] and stamp_of(r.heard["~/net_force"][-1]) == answer.stamp_ns(len(answer) - 1))
    end = time.monotonic() + 0.5
    r.until(lambda: time.monotonic() > end)
    assert stamp_of(r.heard["~/net_force"][-1]) == answer.stamp_ns(len(answer) - 1)
    assert len(r.heard["~/net_force"]) <= len(answer)
