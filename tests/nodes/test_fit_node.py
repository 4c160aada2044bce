"""Claims about fit_node's services and its answers to bad input."""

from __future__ import annotations

import json
import platform
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from rclpy.parameter import Parameter

from diffphys_ros import config, result
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.msg_schemas import clouds, fields, messages
from diffphys_ros.msg_schemas.topics import RESULTS
from diffphys_ros.nodes.fit_node import FitNode, Published

from .robot import Robot


@pytest.fixture
def robot(make_node):
    made = []

    def make(**parameters) -> Robot:
        made.append(Robot(make_node(FitNode, **parameters)))
        return made[-1]

    yield make
    for each in made:
        each.close()


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
    r.until(lambda: r.stages().count("reading") == 2)
    assert {values["run"] for values in r.progress()} == {first, second}
    assert next(values["stage"] for values in r.progress() if values["run"] == second) == "start"
    r.until(lambda: messages.values_of(r.heard["/diagnostics"][-1].status[0])["run"] == second)
    assert r.call("reset").success
    r.until(lambda: not r.node.worker.busy)


def test_a_cancelled_fit_goes_on_from_its_checkpoint_and_leaves_none_behind(resumed):
    assert "checkpoint.npz" in resumed.left
    assert "recovery.npz" not in resumed.left
    assert "0" not in resumed.iterations  # the start was not evaluated again
    metrics = json.loads((resumed.out / "metrics.json").read_text())
    assert metrics["iterations"] == 3
    assert len(metrics["loss_history"]) == 4  # with those of the first fit
    assert not (resumed.out / "checkpoint.npz").exists()


def test_result_and_quality_carry_the_run_and_whose_camera_saw_it(resumed):
    assert json.loads((resumed.out / "metrics.json").read_text())["run"] == resumed.run
    assert {messages.values_of(status)["run"] for status in resumed.quality.status} == {resumed.run}
    assert {status.hardware_id for status in resumed.quality.status} == {"camera_color_optical_frame"}
    assert resumed.quality.header.frame_id == "world"


def test_nothing_is_done_twice_and_where_the_result_is_lost_a_fit_begins_anew(resumed):
    stands, lost = resumed.again
    assert stands == (True, f"run {resumed.run} stands: nothing has changed since; ~/reset forgets it")
    assert lost[0]
    assert re.fullmatch(r"run [0-9a-f]{8} begun", lost[1])


def test_the_last_force_so_far_is_that_of_the_answer(resumed):
    metrics = json.loads((resumed.out / "metrics.json").read_text())
    rows = clouds.particles(resumed.force_so_far[-1 if metrics["refined"] else 0], clouds.FORCE)  # the start is the answer where none is nearer
    so_far, answer = (clouds.xyz(rows, "f") * rows["volume"][..., None]).sum(1), result.load(resumed.out)
    np.testing.assert_allclose(so_far, answer.net_force(), atol=0.02 * np.abs(so_far).max())


def test_it_ends_with_status_0_while_it_plays(resumed):
    assert resumed.status == 0


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
    r.until(lambda: "reading" in r.stages())
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


def test_newtons_of_the_clip_before_are_not_latched_beside_an_answer_that_has_none(robot, made_recovery, made_clip):
    r = robot()
    assumed = replace(made_recovery, metrics=made_recovery.metrics | {"density_source": "assumed 1000 kg/m^3", "metric_scale_source": "unknown: the object is assumed 1 m away"})
    for recovery in (made_recovery, assumed):
        r.node.on_news(Published(fields.answer(recovery, made_clip, config.build({}))))
    assert not r.node.playback.answer.scale.absolute
    for name in ("~/net_force", "~/net_force_sd", "~/state"):
        r.listen(name)  # late
    r.until(lambda: len(r.heard["~/state"]) > 1)
    assert (r.heard["~/net_force"], r.heard["~/net_force_sd"]) == ([], [])


def test_where_fields_are_published_is_said_once_with_resolved_topics(robot, made_recovery, made_clip, capfd):
    r = robot()
    r.node.run = "0123abcd"
    r.node.on_news(Published(fields.answer(made_recovery, made_clip, config.build({}))))
    r.node.on_done([])
    said = capfd.readouterr().err
    assert said.count("run 0123abcd: fields published on " + ", ".join(name.replace("~", "/fit_node") for name in RESULTS)) == 1


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
    assert len(r.heard["~/net_force"]) <= len(answer) + 1  # the first frame is latched before anything is played
