"""Claims about fit_node's services and its answers to bad input, in this process."""

from __future__ import annotations

import json
import platform
import re
import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
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


def test_a_fit_can_be_cancelled_and_begun_again(robot, half_sample, capfd):
    r = robot(bag=half_sample / "clip.mcap", config=half_sample / "given.yaml")
    for name in ("~/progress", "/diagnostics"):
        r.listen(name)
    r.until(lambda: "segment" in r.stages())
    running = r.call("fit")  # one runs
    assert (running.success, running.message) == (False, f"run {r.node.run} is running; call ~/cancel first")
    first = r.node.run
    assert r.call("cancel").message == f"run {first} ends"
    r.until(lambda: r.node.state == "cancelled")
    r.until(lambda: "cancelled" in r.stages())
    assert r.heard["~/progress"][-1].status[0].level == bytes([messages.WARN])
    assert not r.call("cancel").success
    said = capfd.readouterr().err
    assert said.count("cancelled; ~/fit begins again") == 1
    assert "[ERROR]" not in said
    (second,) = re.fullmatch(r"run ([0-9a-f]{8}) begun", r.call("fit").message).groups()
    assert second != first
    r.until(lambda: r.stages().count("segment") == 2)
    assert {values["run"] for values in r.progress()} == {first, second}
    assert next(values["stage"] for values in r.progress() if values["run"] == second) == "start"
    r.until(lambda: messages.values_of(r.heard["/diagnostics"][-1].status[0])["run"] == second)
    assert r.call("reset").success
    r.until(lambda: not r.node.worker.busy)


FEW = {"fit__iterations": 3, "particles__cells": 2, "splats__max_count": 300, "splats__refine_frames": 2}


def test_a_cancelled_fit_goes_on_from_its_checkpoint_and_leaves_none_behind(robot, half_sample, tmp_path):
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text("experiment: {per_cell: 2.0, splat_iterations: 3}")
    files = f"[{half_sample / 'given.yaml'}, {coarse}]"
    bag = {"bag": half_sample / "clip.mcap", "config": files, "out": tmp_path / "out", "resume": True}
    r = robot(**bag, **FEW)
    for name in ("~/progress", "~/quality"):
        r.listen(name)
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
    assert metrics["run"] == r.node.run
    quality = r.heard["~/quality"][-1]
    assert {messages.values_of(status)["run"] for status in quality.status} == {r.node.run}
    assert {status.hardware_id for status in quality.status} == {"camera_color_optical_frame"}
    assert quality.header.frame_id == "world"
    assert_nothing_is_done_twice(r, tmp_path / "out")


def assert_nothing_is_done_twice(r: Robot, out) -> None:
    """~/fit after a fit that is done."""
    run = r.node.run
    again = r.call("fit")
    assert (again.success, r.node.worker.busy, r.node.run) == (True, False, run)
    assert f"run {run} stands" in again.message
    (out / "recovery.npz").rename(out / "elsewhere.npz")
    begins(r)
    (out / "elsewhere.npz").rename(out / "recovery.npz")
    r.node.state, r.node.begun_with = "done", r.node._given()
    assert "stands" in r.call("fit").message
    assert r.node.set_parameters_atomically([Parameter("scene.thickness_m", value=0.06)]).successful
    begins(r)


def begins(r: Robot) -> None:
    """~/fit begins a fit, which is ended again."""
    assert r.call("fit").message == f"run {r.node.run} begun"
    r.call("cancel")
    r.until(lambda: not r.node.worker.busy)


def test_a_recording_that_cannot_be_read_is_said_in_quality_and_the_node_lives_on(robot, tmp_path, capfd):
    (tmp_path / "broken.mcap").write_bytes((sample_folder() / "clip.mcap").read_bytes()[:20_000])
    r = robot(bag=tmp_path / "broken.mcap")
    for name in ("~/quality", "~/progress", "/diagnostics"):
        r.listen(name)
    r.until(lambda: r.heard["~/quality"] and r.heard["/diagnostics"] and "failed" in r.stages())
    status = r.heard["~/quality"][-1].status[0]
    assert status.level == bytes([messages.ERROR])
    assert "broken.mcap" in messages.values_of(status)["reason"]
    assert (status.hardware_id, messages.values_of(status)["run"]) == (platform.node(), r.node.run)
    r.until(lambda: messages.values_of(r.heard["/diagnostics"][-1].status[0])["state"] == "failed")
    assert capfd.readouterr().err.count("broken.mcap: not a complete") == 1  # said once
    assert r.node.exit_status is None


def test_without_a_bag_the_service_says_what_is_missing(robot):
    response = robot().call("fit")
    assert not response.success
    assert "clip/image" in response.message


def test_a_bag_can_be_given_to_a_running_node(robot, half_sample):
    r = robot()
    r.listen("~/progress")
    assert not r.call("fit").success
    refused = r.node.set_parameters_atomically([Parameter("bag", value="/nowhere.mcap")])
    assert "parameter bag: /nowhere.mcap: there is no such file" in refused.reason
    refused = r.node.set_parameters_atomically([Parameter("out", value="/proc/nowhere")])
    assert refused.reason.startswith("parameter out: output folder /proc/nowhere: ")
    assert "--out" not in refused.reason
    changes = [Parameter("bag", value=str(half_sample / "clip.mcap")), Parameter("config", value=str(half_sample / "given.yaml"))]
    assert r.node.set_parameters_atomically(changes).reason.startswith("bag, config, scene.at_rest, ")
    assert r.call("fit").success
    r.until(lambda: "segment" in r.stages())
    assert r.node.waiting_for() == ""
    r.call("cancel")
    r.until(lambda: not r.node.worker.busy)
    assert r.node.set_parameters_atomically([Parameter("bag", value="")]).successful
    assert "clip/image" in r.call("fit").message


def test_where_it_is_asked_for_the_process_ends_with_the_result_or_the_failure(robot, made_recovery, made_clip):
    r = robot(exit_when_done="true")
    r.listen("~/quality")
    r.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    assert r.node.exit_status is None
    r.node.on_done([])
    assert r.node.exit_status == 0
    r.node.state = "failed"
    r.node.on_failed("the clip is broken")
    assert r.node.exit_status == 1


def test_what_is_said_of_a_result_folder_names_the_parameter(robot):
    r = robot()
    r.listen("~/quality")
    r.node.state = "failed"
    r.node.on_failed("output folder x: another run owns it; choose another folder with --out")
    r.until(lambda: r.heard["~/quality"])
    assert r.heard["~/quality"][0].status[0].message == "output folder x: another run owns it; choose another folder with the parameter out"


def test_nothing_is_played_while_nobody_subscribes(robot, made_recovery, made_clip):
    r = robot(playback__rate=4.0)
    r.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    sent, send = [], r.node.send
    r.node.send = lambda name, message: (sent.append(name), send(name, message))
    end = time.monotonic() + 0.5
    r.until(lambda: time.monotonic() > end)
    assert (r.node.playback.frame, set(sent) - {"/diagnostics"}) == (0, set())
    r.listen("~/net_force")
    r.until(lambda: len(r.heard["~/net_force"]) > 3)
    assert r.node.health()["playing"]
    assert set(sent) - {"/diagnostics"} == {"~/net_force"}  # and nothing else is made
    for subscription in list(r.me.subscriptions):
        r.me.destroy_subscription(subscription)
    r.until(lambda: not r.node.health()["playing"])


def test_what_is_set_of_playback_and_publishing_holds_for_the_result_that_is_there(robot, made_recovery, made_clip):
    r = robot(playback__rate=0.01)
    for name in ("~/net_force", "~/force_field"):
        r.listen(name)
    r.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    r.until(lambda: r.heard["~/force_field"])
    few = 12
    assert r.node.set_parameters_atomically([Parameter("publish.max_points", value=few)]).successful
    r.until(lambda: len(r.heard["~/force_field"]) == 2)
    assert [message.width for message in r.heard["~/force_field"]] == [len(made_recovery.points), few]
    assert r.node.set_parameters_atomically([Parameter("playback.rate", value=4.0)]).successful
    r.until(lambda: len(r.heard["~/net_force"]) > 3)  # at 0.01 it would take longer than the test


def test_where_fields_are_published_is_said_once_with_resolved_topics(robot, made_recovery, made_clip, capfd):
    r = robot()
    r.node.run = "0123abcd"
    r.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    r.node.on_done([])
    said = capfd.readouterr().err
    assert said.count("run 0123abcd: fields published on /fit_node/material_field, /fit_node/force_field, /fit_node/quality") == 1


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
