"""Claims about which topics of a camera ingest_node hears."""

from __future__ import annotations

import cv2
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CompressedImage

from diffphys_ros.nodes.clip_out import Sent
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.recorder import MANUAL, MOTION
from tests.filmed import FRAMES, colour
from tests.filmed_cases import plain

RAW, PRESSED, DEPTH, PRESSED_DEPTH = "/image", "/image/compressed", "/depth", "/depth/compressedDepth"


def heard(node) -> set[str]:
    """What the middleware knows the node to subscribe to, by the names that it gives it."""
    found = node.get_subscriber_names_and_types_by_node(node.get_name(), node.get_namespace())
    return {topic for topic, _ in found}


def test_compressed_images_are_looked_for_below_the_raw_ones_wherever_these_are(make_node) -> None:
    node = make_node(IngestNode, "-r", "image:=/cam/color/image_raw", "-r", "depth:=/cam/depth/image_raw")
    assert heard(node) >= {"/cam/color/image_raw", "/cam/color/image_raw/compressed", "/cam/depth/image_raw", "/cam/depth/image_raw/compressedDepth"}
    assert not heard(node) & {RAW, PRESSED, DEPTH, PRESSED_DEPTH}
    assert node.waiting_for() == "/cam/color/image_raw or /cam/color/image_raw/compressed"


def test_a_compressed_topic_that_has_a_name_of_its_own_keeps_it(make_node) -> None:
    node = make_node(IngestNode, "-r", "image:=/cam/image_raw", "-r", "image/compressed:=/wifi/jpeg", "-r", "__ns:=/robot1")
    assert heard(node) >= {"/cam/image_raw", "/wifi/jpeg", "/robot1/depth", "/robot1/depth/compressedDepth"}
    assert "/cam/image_raw/compressed" not in heard(node)


def test_a_transport_that_is_not_wanted_is_not_subscribed_to_so_that_the_driver_need_not_make_it(make_node) -> None:
    node = make_node(IngestNode, image_transport="compressed", depth_transport="raw")
    assert heard(node) >= {PRESSED, DEPTH}
    assert not heard(node) & {RAW, PRESSED_DEPTH}
    assert node.waiting_for() == PRESSED


def test_images_that_come_by_both_transports_are_used_once_and_that_is_said_once(make_node, capfd) -> None:
    node, jpeg = make_node(IngestNode), cv2.imencode(".jpg", plain())[1].tobytes()
    for message in colour(plain()):
        raw = to_ros("sensor_msgs/msg/Image", message[3])
        node.take("image", raw)
        node.take("image/compressed", CompressedImage(header=raw.header, format="jpeg", data=jpeg))
    assert node.health()["frames"] == node.health()["ignored"] == FRAMES
    said = capfd.readouterr().err
    assert said.count("/image and /image/compressed bring the same images") == 1
    assert "set image_transport" in said


def test_settings_that_choose_topics_of_a_recording_are_said_to_change_nothing_for_a_camera(make_node, capfd) -> None:
    make_node(IngestNode, topics__image="/cam/image_raw", topics__depth="none")
    said = capfd.readouterr().err
    assert "topics.image chooses a topic of a recording and changes nothing here; of a camera: -r image:=/cam/image_raw" in said
    assert "topics.depth" not in said


@pytest.mark.parametrize(("words", "warned"), [(("-r", "depth:=/cam/depht"), True), ((), False)])
def test_a_clip_without_depth_is_said_and_a_warning_where_depth_was_named(make_node, capfd, words, warned: bool) -> None:
    node = make_node(IngestNode, *words)
    node.on_done(Sent(9, 0.1, [], with_depth=False))
    said = capfd.readouterr().err
    assert "published a clip of 9 frames, 100.0 ms apart, without depth" in said
    assert ("/cam/depht: no depth image came, though the topic was named" in said) == warned
    node.on_done(Sent(9, 0.1, [], with_depth=True))
    assert "100.0 ms apart, with depth" in capfd.readouterr().err


def test_what_opens_a_clip_can_be_changed_on_a_running_node(make_node) -> None:
    node = make_node(IngestNode)
    result = node.set_parameters_atomically([Parameter("clip.trigger", value=MANUAL), Parameter("clip.seconds", value=3.0), Parameter("silence_s", value=0.5)])
    assert (result.successful, result.reason) == (True, "")  # at once
    for message in colour(plain()):
        node.take("image", to_ros("sensor_msgs/msg/Image", message[3]))
    assert not node.health()["recording"]
    assert (node.recorder.trigger, node.recorder.seconds, node.recorder.armed) == (MANUAL, 3.0, False)
    node.set_parameters([Parameter("clip.trigger", value=MOTION)])
    assert node.recorder.armed
    assert node.set_parameters_atomically([Parameter("patience_s", value=1.0)]).reason == "patience_s: holds for the next job"
