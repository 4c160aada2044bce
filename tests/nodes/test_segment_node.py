"""Claims about segment_node: a click, a mask or motion chooses the object, in this process."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.executors import SingleThreadedExecutor

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clicks import pixel_of
from diffphys_ros.nodes.clip_topics import clip_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.segment_job import label
from diffphys_ros.nodes.segment_node import CLICK, FIRST_MASK, SegmentNode
from diffphys_ros.outline import covered
from diffphys_ros.progress import finished
from diffphys_ros.segment import Mark
from tests.plain_strips import Strip

from .processes import PATIENCE_S

TEXTURE = np.random.default_rng(4).integers(0, 256, (16, 16, 3), dtype=np.uint8)


@pytest.fixture
def two_blocks(made_clip):
    """The made clip's block, textured, and above it a smaller one that slides the other way."""
    frames = made_clip.frames.repeat(2, 1).repeat(2, 2)
    frames = np.full_like(frames, 90)
    for k, frame in enumerate(frames):
        swing = round(5 * np.sin(0.8 * k))
        frame[60:84, 40 + swing : 88 + swing] = np.kron(TEXTURE[:6, :12], np.ones((4, 4, 1), np.uint8))
        frame[16:40, 50 - swing : 74 - swing] = np.kron(TEXTURE[8:14, :6], np.ones((4, 4, 1), np.uint8))
    camera = made_clip.camera
    k = camera.pixel_from_camera * np.array([[2], [2], [1]])
    return replace(made_clip, frames=frames, labels=None, camera=replace(camera, pixel_from_camera=k, width=128, height=96))


class Watched(SegmentNode):
    """Keeps the label images that it publishes."""

    def __init__(self) -> None:
        self.published: list[np.ndarray] = []
        self.failure = ""
        super().__init__()

    def on_done(self, masks) -> None:
        super().on_done(masks)
        self.published = [np.frombuffer(fields["data"], np.uint8).reshape(fields["height"], fields["width"]) for _, fields in masks]

    def on_failed(self, reason: str) -> None:
        super().on_failed(reason)
        self.failure = reason


def feed(node: Watched, clip) -> None:
    for topic, fields in clip_messages(clip, slot_stamps(clip)):
        node.take(topic, to_ros(TOPICS[topic].type_name, fields))


def spin(node: Watched, done, timeout_s: float = PATIENCE_S) -> None:
    executor, end = SingleThreadedExecutor(), time.monotonic() + timeout_s
    executor.add_node(node)
    while not done():
        assert time.monotonic() < end, node.waiting_for() or node.failure
        executor.spin_once(timeout_sec=0.05)
    executor.remove_node(node)


def click_at(u: float, v: float, frame_id: str = "camera_optical", z: float = 0.0) -> PointStamped:
    message = PointStamped()
    message.header.frame_id = frame_id
    message.point.x, message.point.y, message.point.z = float(u), float(v), float(z)
    return message


def test_a_click_is_waited_for_and_chooses_the_object(make_node, two_blocks) -> None:
    node = make_node(Watched, wait_for=CLICK)
    feed(node, two_blocks)
    assert node.waiting_for() == f"/{CLICK}"
    node.tell(CLICK, click_at(62, 28))
    spin(node, lambda: node.published or node.failure)
    assert (node.published[0][18:38, 52:72] > 0).mean() > 0.9
    assert not node.published[0][60:].any()


def test_a_click_after_the_labels_labels_again(make_node, two_blocks) -> None:
    node = make_node(Watched)
    feed(node, two_blocks)
    spin(node, lambda: node.published or node.failure)
    assert (node.published[0][62:82, 44:84] > 0).mean() > 0.9  # the largest moving region
    node.published = []
    person = rclpy.create_node("person")
    clicks = person.create_publisher(PointStamped, CLICK, 1)
    spin(node, clicks.get_subscription_count)
    clicks.publish(click_at(62, 28))
    spin(node, lambda: node.published or node.failure)
    person.destroy_node()
    assert (node.published[0][18:38, 52:72] > 0).mean() > 0.9


def test_a_mask_from_a_topic_is_the_object(make_node, two_blocks) -> None:
    node = make_node(Watched, wait_for=FIRST_MASK, segment__max_parts=1)
    feed(node, two_blocks)
    mask = np.zeros((96, 128), np.uint8)
    mask[60:84, 40:88] = 255
    node.tell(FIRST_MASK, to_ros("sensor_msgs/msg/Image", messages.image(messages.header(0, "camera_optical"), mask, "mono8")))
    spin(node, lambda: node.published or node.failure)
    assert np.array_equal(node.published[0] > 0, mask > 0)


@pytest.mark.parametrize("what", [CLICK, FIRST_MASK])
def test_what_is_clicked_or_masked_reaches_segmentation_beside_the_settings_that_a_person_set(make_node, two_blocks, monkeypatch, what) -> None:
    got = []

    def elsewhere(job, *given):
        assert job is label
        yield got.append(given)
        return np.zeros(given[0].frames.shape[:3], np.uint8)

    monkeypatch.setattr("diffphys_ros.nodes.segment_node.steps", elsewhere)
    node = make_node(Watched, wait_for=what, segment__point_px="[60.0, 70.0]", segment__method="otsu")
    feed(node, two_blocks)
    mask = np.full((96, 128), 255, np.uint8)
    node.tell(what, click_at(62, 28) if what == CLICK else to_ros("sensor_msgs/msg/Image", messages.image(messages.header(0), mask, "mono8")))
    spin(node, lambda: node.published or node.failure)
    ((clip, settings, mark),) = got
    assert settings == node.parameters.settings()
    assert (settings.segment.point_px, settings.segment.method) == ([60.0, 70.0], "otsu")
    assert clip.first_labels is None
    if what == CLICK:
        assert (mark.point.tolist(), mark.labels) == ([62, 28], None)
    else:
        assert mark.point is None
        assert np.array_equal(mark.labels, mask)


def test_a_plain_strip_that_swings_is_labelled_as_in_its_fit_whatever_was_clicked() -> None:
    strip = Strip(frames=100)
    truth = np.stack([covered(strip.outline(sway), strip.size) > 0.5 for sway in strip.sway()])
    for mark in (Mark(), Mark(point=np.array([5.0, 5.0]))):
        labels = finished(label(strip.clip(), config.build({}), mark)) > 0
        assert (labels & truth).sum() > 0.99 * (labels | truth).sum()  # by flow .95


def test_a_click_beside_every_object_is_answered_with_a_sentence(make_node, two_blocks) -> None:
    node = make_node(Watched, wait_for=CLICK)
    feed(node, two_blocks)
    node.tell(CLICK, click_at(5, 90))
    spin(node, lambda: node.published or node.failure)
    assert "click on the object" in node.failure


def test_topics_are_called_by_their_resolved_names_in_what_is_waited_for_dropped_and_refused(make_node, two_blocks) -> None:
    node = make_node(Watched, "-r", "__ns:=/robot1", "-r", "clip/image:=/frames", wait_for=CLICK)
    warned, said = [], [(topic, to_ros(TOPICS[topic].type_name, fields)) for topic, fields in clip_messages(two_blocks, slot_stamps(two_blocks))]
    node.get_logger().warning = warned.append
    lost = next(k for k, (topic, _) in enumerate(said) if topic == "clip/image")
    for topic, message in (*said[:lost], *said[lost + 1 :]):
        node.take(topic, message)
    assert node.waiting_for().startswith(f"/frames (all {len(two_blocks)} that /robot1/clip/end announced")
    for start_ns, words in ((10**9, "it still lacked /frames (all"), (2 * 10**9, "it still lacked /robot1/click;")):
        later = replace(two_blocks, start_ns=two_blocks.start_ns + start_ns)
        feed(node, later)
        assert words in warned[-1]
    with pytest.raises(InputError, match=r"^topic /frames: encoding is '32FC1'"):
        node.take("clip/image", to_ros("sensor_msgs/msg/Image", messages.image(messages.header(1), np.zeros((2, 2), np.float32), "32FC1")))
    with pytest.raises(InputError, match=r"^topic /robot1/click: the point"):
        node.tell(CLICK, click_at(np.nan, 0))


def test_points_in_pixels_camera_and_world_name_one_pixel(made_clip) -> None:
    camera = made_clip.camera
    world = camera.backproject(np.array([20.0, 30.0]), np.array(0.7))
    local = camera.world_from_camera[:3, :3].T @ (world - camera.position)
    for click in (click_at(20, 30), click_at(20, 30, ""), click_at(*local[:2], z=local[2]), click_at(*world[:2], "world", world[2])):
        assert np.allclose(pixel_of(click, camera, CLICK), [20, 30])


@pytest.mark.parametrize(("click", "sentence"), [(click_at(0, 0, "map", 1), "must be in 'camera_optical' or 'world'"), (click_at(0, -3, "world", 1), "behind the camera")])
def test_points_that_are_no_pixel_are_refused(made_clip, click, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        pixel_of(click, made_clip.camera, CLICK)
