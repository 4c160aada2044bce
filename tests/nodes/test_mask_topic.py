"""Claims about a mask topic on its way from a recording to the labels, with the nodes as real processes."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.nodes.clip_buffer import MASK, ClipBuffer
from diffphys_ros.nodes.clip_stage import CLIP
from diffphys_ros.nodes.convert import message_class
from diffphys_ros.nodes.qos import profile
from diffphys_ros.segment import label_clip
from diffphys_ros.types import Camera, Clip

from .processes import PATIENCE_S, Domain

SEGMENTER = "/segmenter/mask"
SETTINGS = {"segment__max_parts": 1}
IMAGE = "sensor_msgs/msg/Image"


@pytest.fixture(scope="module")
def masked_clip():
    """Two swinging squares; the smaller one, which motion would not choose, is what the mask topic marks."""
    texture = np.random.default_rng(0).integers(40, 250, (12, 12, 3)).astype(np.uint8)
    frames = np.full((12, 96, 128, 3), 90, np.uint8)
    for k, frame in enumerate(frames):
        shift = round(6 * np.sin(0.5 * k))
        frame[56:88, 40 + shift : 88 + shift] = np.kron(texture[:8], np.ones((4, 4, 1), np.uint8))
        frame[16:40, 50 - shift : 74 - shift] = np.kron(texture[6:, :6], np.ones((4, 4, 1), np.uint8))
    camera = Camera(np.array([[100.0, 0, 63.5], [0, 100, 47.5], [0, 0, 1]]), np.eye(4), 128, 96, "camera_optical")
    labels = np.zeros((96, 128), np.uint8)
    labels[16:40, 50:74] = 1
    labels[16:24, 50:58] = 255
    return Clip(frames, 1_700_000_000_000_000_000, 1 / 30, camera, first_labels=labels)


@pytest.fixture(scope="module")
def bag(masked_clip, tmp_path_factory):
    """The clip as a driver and a segmenter record it; the segmenter is late and has masks of later frames too."""
    clip, path = masked_clip, tmp_path_factory.mktemp("bag") / "clip.mcap"

    def recorded():
        info = messages.camera_info(messages.header(clip.start_ns, clip.camera.frame_id), clip.camera)
        yield "/camera/camera_info", "sensor_msgs/msg/CameraInfo", clip.start_ns, info, False
        for k, frame in enumerate(clip.frames):
            stamp = clip.start_ns + round(k * clip.period_s * 1e9)
            yield "/camera/image_raw", IMAGE, stamp, messages.image(messages.header(stamp, "camera_optical"), frame, "rgb8"), False
            later = messages.header(stamp + 10**6, "camera_optical")
            yield SEGMENTER, IMAGE, stamp + 2 * 10**6, messages.image(later, np.roll(clip.first_labels, 5 * k, 1), "mono8"), False

    write_recording(path, recorded())
    return path


@pytest.fixture(scope="module")
def expected(bag):
    """What one process makes of the recording."""
    settings = config.build({"topics.mask": SEGMENTER, "segment.max_parts": 1})
    clip = read_clip(bag, settings)
    return clip, label_clip(clip, settings)


def received(domain: Domain, timeout_s: float = PATIENCE_S) -> ClipBuffer:
    """The clip and its masks, as a listener hears them that came with the nodes."""
    context, buffer = rclpy.Context(), ClipBuffer()
    rclpy.init(context=context, domain_id=int(domain.environment["ROS_DOMAIN_ID"]))
    node, executor = rclpy.create_node("listener", context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    for name in (*CLIP, MASK):
        node.create_subscription(message_class(TOPICS[name].type_name), name, lambda m, n=name: buffer.take(n, m), profile(TOPICS[name]))
    until = time.monotonic() + timeout_s
    while buffer.missing(masks=True):
        said = "\n".join(domain.said(name) for name in domain.running)
        assert time.monotonic() < until, f"waiting for {buffer.missing(masks=True)}:\n{said}"
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    return buffer


def assert_as_in_one_process(buffer: ClipBuffer, expected) -> None:
    clip, labels = expected
    found = buffer.clip()
    np.testing.assert_array_equal(found.frames, clip.frames)
    np.testing.assert_array_equal(found.first_labels, clip.first_labels)
    np.testing.assert_array_equal(found.labels, labels)
    assert (labels[0] == 1).sum() == 512  # the small square less what is ignored, not the large one that moves more
    assert (labels[0] == 255).sum() == 64


@pytest.fixture(scope="module")
def live(bag, tmp_path_factory):
    """What a listener heard of the first of two recordings that a camera played to the same nodes, what segment_node said, and how they ended."""
    with Domain(tmp_path_factory.mktemp("live")) as domain:
        domain.start("camera1", "-m", "diffphys_ros.nodes.replay", str(bag), "--inputs", "--mask", SEGMENTER)
        domain.node("segment_node", **SETTINGS)
        domain.node("ingest_node", reliability="reliable", silence_s=3.0)
        first = received(domain)
        for number in (1, 2):
            if number > 1:
                domain.start(f"camera{number}", "-m", "diffphys_ros.nodes.replay", str(bag), "--inputs", "--mask", SEGMENTER)
            until = time.monotonic() + PATIENCE_S
            while domain.said("segment_node").count("published 12 label images") < number:
                assert time.monotonic() < until, "\n".join(domain.said(name) for name in domain.running)
                time.sleep(0.1)
            assert domain.end(f"camera{number}", signal.SIGINT) == 0
            assert called(domain, "/ingest_node/reset").success
        said = domain.said("segment_node")
        return first, said, [domain.end(name, signal.SIGINT) for name in ("segment_node", "ingest_node")]


def test_a_recorded_mask_topic_reaches_the_segmenter_through_a_live_camera(live, expected):
    first, _, statuses = live
    assert_as_in_one_process(first, expected)
    assert statuses == [0, 0]


def test_a_recorded_mask_topic_reaches_the_segmenter_from_the_bag(bag, expected, tmp_path):
    with Domain(tmp_path) as domain:
        domain.node("segment_node", **SETTINGS)
        domain.node("ingest_node", bag=bag, topics__mask=SEGMENTER)
        assert_as_in_one_process(received(domain), expected)
        assert domain.end_all() == dict.fromkeys(domain.running, 0)


def test_a_second_clip_goes_through_the_same_nodes(live):
    _, said, _ = live
    assert said.count("published 12 label images") == 2
    assert "waiting for" not in said.partition("published 12")[2]


def called(domain: Domain, service: str):
    """The answer of a service."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain.environment["ROS_DOMAIN_ID"]))
    node, executor = rclpy.create_node("person", context=context), SingleThreadedExecutor(context=context)
    client = node.create_client(Trigger, service)
    assert client.wait_for_service(PATIENCE_S)
    future = client.call_async(Trigger.Request())
    executor.add_node(node)
    executor.spin_until_future_complete(future, PATIENCE_S)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    return future.result()
