"""Claims about ingest_node: raw topics to a clip, in this process."""

from __future__ import annotations

import time

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_stage import CLIP
from diffphys_ros.nodes.convert import message_class, to_ros
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.qos import latched, profile, sensor

from .processes import PATIENCE_S


class Camera:
    """A driver that publishes a clip's frames as raw topics, and a listener on clip/*."""

    def __init__(self, node: IngestNode) -> None:
        self.node, self.me, self.buffer = node, rclpy.create_node("camera"), ClipBuffer()
        self.executor = SingleThreadedExecutor()
        for each in (node, self.me):
            self.executor.add_node(each)
        self.image = self.me.create_publisher(Image, "image", sensor("reliable"))
        self.info = self.me.create_publisher(CameraInfo, "camera_info", sensor("reliable"))
        self.pose = self.me.create_publisher(TransformStamped, "camera_pose", latched())
        self.until(lambda: self.image.get_subscription_count() and self.info.get_subscription_count())

    def until(self, condition, timeout_s: float = PATIENCE_S) -> None:
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"waiting for {self.node.waiting_for()}"
            self.executor.spin_once(timeout_sec=0.02)

    def publish(self, clip, frames, *, k_scale: float = 1.0) -> None:
        info = messages.camera_info(messages.header(clip.start_ns, clip.camera.frame_id), clip.camera)
        self.info.publish(to_ros("sensor_msgs/msg/CameraInfo", info | {"k": info["k"] * k_scale}))
        self.pose.publish(to_ros("geometry_msgs/msg/TransformStamped", messages.camera_pose(clip.start_ns, clip.camera)))
        for k in frames:
            head = messages.header(clip.start_ns + round(k * clip.period_s * 1e9), clip.camera.frame_id)
            self.image.publish(to_ros("sensor_msgs/msg/Image", messages.image(head, clip.frames[k], "rgb8")))

    def listen(self) -> None:
        for name in CLIP:
            topic = TOPICS[name]
            self.me.create_subscription(message_class(topic.type_name), name, lambda m, n=name: self.buffer.take(n, m), profile(topic))

    def call(self, service: str):
        client = self.me.create_client(Trigger, f"/ingest_node/{service}")
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()


@pytest.fixture
def camera(make_node):
    made = []

    def make(**parameters) -> Camera:
        made.append(Camera(make_node(IngestNode, reliability="reliable", **parameters)))
        return made[-1]

    yield make
    for each in made:
        each.executor.shutdown()
        each.me.destroy_node()


def test_silence_ends_the_clip_and_a_late_listener_gets_all_of_it(camera, made_clip):
    c = camera(silence_s=2.0)
    c.publish(made_clip, [k for k in range(len(made_clip)) if k != 4])
    c.until(lambda: c.node.state == "done")
    c.listen()
    c.until(lambda: not c.buffer.missing(masks=False))
    clip = c.buffer.clip()
    assert clip.camera.world_frame_id == "world"
    np.testing.assert_array_equal(clip.seen, np.arange(len(made_clip)) != 4)
    np.testing.assert_array_equal(clip.frames[clip.seen], made_clip.frames[clip.seen])


def test_silence_ends_the_clip_though_the_simulated_time_stands_still(camera, made_clip):
    c = camera(silence_s=0.3, use_sim_time="true")  # as when a recording, and its /clock, has ended
    c.publish(made_clip, range(len(made_clip)))
    c.until(lambda: c.node.state == "done", 30.0)


def test_images_that_wait_while_the_node_is_held_up_are_no_silence(camera, made_clip):
    c, half = camera(silence_s=0.5), len(made_clip) // 2
    c.publish(made_clip, range(half))
    c.until(lambda: c.node.health()["frames"] == half)
    c.publish(made_clip, range(half, len(made_clip)))
    time.sleep(0.8)  # nothing is taken meanwhile
    c.listen()
    c.until(lambda: c.buffer.announced)
    assert len(c.buffer.announced) == len(made_clip)


def test_the_service_ends_the_clip_and_what_comes_later_opens_none_before_reset(camera, made_clip):
    c = camera(silence_s=1000.0)
    assert not c.call("end").success  # nothing there yet
    c.publish(made_clip, range(len(made_clip)))
    c.until(lambda: c.node.health()["frames"] == len(made_clip))
    assert c.call("end").success
    c.until(lambda: c.node.state == "done")
    c.publish(made_clip, range(3))
    c.until(lambda: c.node.health()["frames"] == 3)
    assert not c.node.health()["recording"]
    assert c.call("reset").success
    c.publish(made_clip, range(5))
    c.until(lambda: c.node.health()["recording"] and c.node.health()["frames"] == 5)


def test_a_recording_that_starts_over_ends_the_clip(camera, made_clip):
    from dataclasses import replace

    slow = replace(made_clip, period_s=0.5)
    c = camera(silence_s=1000.0)
    c.publish(slow, range(len(slow)))
    c.publish(slow, range(1))
    c.until(lambda: c.node.state == "done")
    c.listen()
    c.until(lambda: not c.buffer.missing(masks=False))
    assert len(c.buffer.announced) == len(slow)
    assert not c.node.health()["recording"]


def test_a_camera_without_focal_length_is_refused_with_a_sentence(camera, made_clip):
    c = camera(silence_s=0.3)
    failures = []
    c.node.on_failed = failures.append
    c.publish(made_clip, range(len(made_clip)), k_scale=0.0)
    c.until(lambda: failures)
    assert "K[0]" in failures[0]
    assert c.node.state == "failed"
