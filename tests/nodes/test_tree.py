"""Claims about who places the camera for viewers."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from diffphys_ros import config
from diffphys_ros.msg_schemas import fields
from diffphys_ros.nodes.stage import StageNode
from diffphys_ros.nodes.tree import Tree, is_missing

ELSEWHERE = [("base_link", "gripper")]
PLACED = [("world", "arm"), ("arm", "camera_optical")]
ABOVE = [("camera_optical", "camera_imu")]


@pytest.mark.parametrize(
    ("links", "posed", "missing"),
    [([], True, True), ([], False, True), (ELSEWHERE, True, True), (PLACED, True, False), (PLACED, False, False), (ABOVE, True, True), (ABOVE, False, False)],
)
def test_a_camera_is_placed_only_where_nobody_else_does(made_recovery, made_clip, links, posed, missing):
    camera = made_clip.camera if posed else replace(made_clip.camera, world_from_camera=np.eye(4), world_frame_id="")
    answer = fields.answer(made_recovery, replace(made_clip, camera=camera), config.Settings())
    assert is_missing(answer, links) == missing


@pytest.mark.skipif(find_spec("tf2_msgs") is not None, reason="tf2_msgs is installed")
def test_without_tf2_msgs_nothing_is_said_and_nothing_breaks(make_node, made_recovery, made_clip):
    node = make_node(lambda: StageNode("fit_node"))
    Tree(node).announce(fields.answer(made_recovery, made_clip, config.Settings()))
    assert "/tf_static" not in dict(node.get_topic_names_and_types())


@pytest.mark.skipif(find_spec("tf2_msgs") is None, reason="tf2_msgs is not on PyPI; source a ROS 2 Jazzy")
def test_the_camera_of_an_answer_stands_in_the_tree(make_node, made_recovery, made_clip):
    import time

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import DurabilityPolicy, QoSProfile

    from diffphys_ros.nodes.convert import message_class

    node, heard, executor = make_node(lambda: StageNode("fit_node")), [], SingleThreadedExecutor()
    robot = rclpy.create_node("robot")
    robot.create_subscription(message_class("tf2_msgs/msg/TFMessage"), "/tf_static", heard.append, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    Tree(node).announce(fields.answer(made_recovery, made_clip, config.Settings()))
    for each in (node, robot):
        executor.add_node(each)
    end = time.monotonic() + 60
    while not heard and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    robot.destroy_node()
    assert heard[0].transforms[0].child_frame_id == "camera_optical"
