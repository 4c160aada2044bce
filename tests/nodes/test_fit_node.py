"""Claims about fit_node's services and its answers to bad input."""

from __future__ import annotations

import json
import time

import pytest

from diffphys_ros import config
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.msg_schemas import clouds, fields, messages
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


def test_a_cancelled_fit_goes_on_from_its_checkpoint_and_leaves_none_behind(resumed):
    assert "checkpoint.npz" in resumed.left
    assert "recovery.npz" not in resumed.left
    assert "0" not in resumed.iterations  # the start was not evaluated again
    metrics = json.loads((resumed.out / "metrics.json").read_text())
    assert metrics["iterations"] == 3
    assert len(metrics["loss_history"]) == 4  # with those of the first fit
    assert not (resumed.out / "checkpoint.npz").exists()


def test_it_ends_with_status_0_while_it_plays(resumed):
    assert resumed.status == 0


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
    r.until(lambda: r.node.playback.frame > 2)
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
