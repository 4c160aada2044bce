"""Claims about geometry on live topics: they give the very clip that a recording of them gives, and what is missing is waited for."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message, serialize_message

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.world import NotYetError
from diffphys_ros.bags.write import write_recording
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS
from diffphys_ros.nodes.beside import COLOUR_INFO, DEPTH_INFO, Beside
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_checks import in_world
from diffphys_ros.nodes.clip_out import messages_of
from diffphys_ros.nodes.clip_stage import CLIP
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import message_class, to_ros
from diffphys_ros.nodes.fit_node import FitNode, _elsewhere
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.intake import Intake
from diffphys_ros.nodes.qos import latched, profile, sensor
from diffphys_ros.nodes.segment_node import SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode
from diffphys_ros.types import Clip
from tests.filmed import COLOUR_FRAME, DEPTH_FRAME, POSE, ROLES, TREE, K, Message, colour, image, imu, info, link, pose, stamp_of
from tests.filmed_cases import CAMERA_IN_WORLD, CASES, DEPTH_IN_COLOUR, NOT_YET, REFUSED, P, depth_camera, plain, rectified

from .processes import PATIENCE_S

MIB = 2**20


def heard(messages: list[Message]) -> Intake:
    """What ingest_node has of a driver's messages, each once over the wire's encoding."""
    names = {role: topic for topic, role in ROLES.items() if any(message[0] == topic for message in messages)}
    intake, images = Intake(1200, 64 * MIB, Beside(names)), []
    for topic, kind, ns, fields, _ in sorted(messages, key=lambda message: message[2]):
        role = ROLES[topic]
        if kind == TREE:
            for each in fields["transforms"]:
                intake.beside.take_link(on_wire(POSE, each), role)
            continue
        message = on_wire(kind, fields)
        if role.startswith("image"):
            intake.take_image(role, message)
            images.append(ns)
        elif role in (COLOUR_INFO, DEPTH_INFO):
            intake.beside.take_info(message, role, after_ns=images[-1] if images else 0)
        elif role == "imu":
            intake.beside.take_imu(message)
        else:
            intake.take_depth(message)
    return intake


def clip_of(intake: Intake, settings: config.Settings) -> Clip:
    """What a listener makes of the messages, with what ingest_node says of them."""
    buffer, steps = ClipBuffer(), messages_of(intake, settings)
    while True:
        try:
            topic, fields = next(steps)
        except StopIteration as stop:
            return replace(buffer.clip(), notes=tuple(stop.value.notes))
        buffer.take(topic, on_wire(TOPICS[topic].type_name, fields))


def on_wire(kind: str, fields: dict[str, Any]) -> Any:
    return deserialize_message(serialize_message(to_ros(kind, fields)), message_class(kind))


def assert_same(live: Clip, recorded: Clip) -> None:
    np.testing.assert_array_equal(live.frames, recorded.frames)
    assert (live.depth is None) == (recorded.depth is None)
    if live.depth is not None:
        np.testing.assert_array_equal(live.depth, recorded.depth)
    np.testing.assert_array_equal(live.camera.pixel_from_camera, recorded.camera.pixel_from_camera)
    np.testing.assert_allclose(live.camera.world_from_camera, recorded.camera.world_from_camera, atol=1e-12)
    assert (live.camera.frame_id, live.camera.world_frame_id) == (recorded.camera.frame_id, recorded.camera.world_frame_id)
    np.testing.assert_array_equal(live.gravity, recorded.gravity)
    assert [note for note in live.notes if "camera_info" not in note] == [note for note in recorded.notes if "camera_info" not in note]
    assert len(live.notes) == len(recorded.notes)


@pytest.mark.parametrize("name", CASES)
def test_live_topics_give_the_clip_that_their_recording_gives(name: str, tmp_path: Path) -> None:
    messages, given = CASES[name]()
    settings = config.build({key: value for key, value in given.items() if key != "topics.image"})
    live = clip_of(heard(messages), settings)
    assert_same(live, read_clip(write_recording(tmp_path / "clip.mcap", messages), config.build(given)))


@pytest.mark.parametrize("name", [*REFUSED, *NOT_YET])
def test_live_geometry_that_would_be_wrong_is_refused_like_a_recordings(name: str) -> None:
    case, words = (REFUSED | NOT_YET)[name]
    messages, given = case()
    with pytest.raises(InputError, match=words.replace("raw topics", "")) as caught:
        clip_of(heard(messages), config.build(given))
    assert isinstance(caught.value, NotYetError) == (name in NOT_YET)


class Driver:
    """Publishes messages on a node's inputs over DDS, and listens on clip/*."""

    def __init__(self, node: IngestNode, remapped: dict[str, str]) -> None:
        self.node, self.me, self.buffer = node, rclpy.create_node("driver"), ClipBuffer()
        self.remapped, self.outputs = remapped, {}
        self.executor = SingleThreadedExecutor()
        for each in (node, self.me):
            self.executor.add_node(each)
        for name in CLIP:
            row = TOPICS[name]
            self.me.create_subscription(message_class(row.type_name), name, lambda m, n=name: self.buffer.take(n, m), profile(row))

    def until(self, condition, timeout_s: float = PATIENCE_S) -> None:
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"waiting for {self.node.waiting_for()}"
            self.executor.spin_once(timeout_sec=0.02)

    def send(self, messages) -> None:
        for topic, kind, _, fields, _ in messages:
            self.publish(self.remapped.get(ROLES[topic], ROLES[topic]), kind, fields)

    def publish(self, name: str, kind: str, fields: dict[str, Any]) -> None:
        if name not in self.outputs:
            quality = latched() if kind == POSE else sensor("reliable")
            self.outputs[name] = self.me.create_publisher(message_class(kind), name, quality)
            self.until(lambda: self.outputs[name].get_subscription_count())
        self.outputs[name].publish(to_ros(kind, fields))

    def clip(self) -> Clip:
        self.until(lambda: not self.buffer.missing(masks=False))
        return self.buffer.clip()


@pytest.fixture
def driver(domain: int):
    made = []

    def make(*words: str, remapped: dict[str, str] | None = None, **parameters: object) -> Driver:
        given = {"reliability": "reliable", "silence_s": 0.5, **parameters}
        arguments = [w for key, value in given.items() for w in ("-p", f"{key.replace('__', '.')}:={value}")]
        renames = [w for name, other in (remapped or {}).items() for w in ("-r", f"{name}:={other}")]
        rclpy.init(args=["--ros-args", *arguments, *renames, *words], domain_id=domain)
        made.append(Driver(IngestNode(), remapped or {}))
        return made[-1]

    yield make
    for each in made:
        each.executor.shutdown()
        each.me.destroy_node()
        each.node.close()
        each.node.destroy_node()
    rclpy.try_shutdown()


def test_a_remapped_rectified_topic_is_not_undistorted_again_and_is_waited_for_by_its_name(driver) -> None:
    d = driver(remapped={"image": "/camera/color/image_rect", "camera_info": "/camera/color/camera_info"})
    assert d.node.waiting_for().startswith("/camera/color/image_rect or ")
    messages = rectified()
    d.send(messages[-1:])
    d.send(messages[:-1])
    clip = d.clip()
    np.testing.assert_array_equal(clip.frames[1], np.frombuffer(messages[1][3]["data"], np.uint8).reshape(clip.frames[1].shape))
    np.testing.assert_array_equal(clip.camera.pixel_from_camera, P[:, :3])


def test_a_clip_waits_for_the_transform_that_its_settings_need(driver) -> None:
    d = driver(scene__gravity_m_s2="[0.0, 0.0, -9.81]")
    warned = []
    d.node.get_logger().warning = warned.append
    d.send([info()])
    d.send(colour(plain()))
    d.until(lambda: d.node.lacking)
    assert "scene.gravity_m_s2 is told in the world" in d.node.waiting_for()
    assert any("waiting for it for 10 s" in words for words in warned)
    d.publish("camera_pose", POSE, link("world", COLOUR_FRAME, CAMERA_IN_WORLD))
    clip = d.clip()
    assert clip.camera.world_frame_id == "world"
    np.testing.assert_allclose(clip.camera.world_from_camera, CAMERA_IN_WORLD, atol=1e-9)


def test_a_clip_waits_for_its_camera_info_and_says_that_it_came_late(driver) -> None:
    d = driver()
    warned = []
    d.node.get_logger().warning = warned.append
    d.send(colour(plain()))
    d.until(lambda: d.node.dispatch.waiting)
    assert d.node.waiting_for() == "/camera_info"
    d.send([info()])
    np.testing.assert_array_equal(d.clip().camera.pixel_from_camera, K)
    assert any("/camera_info came 0.17 s after the first image" in words for words in warned)


def test_what_does_not_come_ends_the_wait_with_the_sentence_and_the_next_clip_is_collected(driver) -> None:
    d, failed = driver(patience_s=0.3, scene__target_frame="map"), []
    d.node.on_failed = lambda reason, before=d.node.on_failed: (failed.append(reason), before(reason))
    d.send([info()])
    d.send(colour(plain()))
    d.until(lambda: failed)
    assert "no transform from map to the camera's color_optical is known" in failed[0]
    d.publish("camera_pose", POSE, link("map", COLOUR_FRAME, CAMERA_IN_WORLD))
    d.send(colour(plain()))
    assert d.clip().camera.world_frame_id == "map"


def test_a_depth_camera_and_an_imu_over_the_wire_reach_the_listener(driver, tmp_path: Path) -> None:
    messages = depth_camera() + list(imu((0.0, -9.8, 0.0), COLOUR_FRAME))
    d = driver()
    d.publish("camera_pose", POSE, link(COLOUR_FRAME, DEPTH_FRAME, DEPTH_IN_COLOUR))
    rest = [message for message in messages if message[1] != TREE]
    d.send(sorted(rest, key=lambda message: (not message[0].endswith("camera_info"), "color" in message[0], message[2])))
    clip = d.clip()
    recorded = read_clip(write_recording(tmp_path / "clip.mcap", messages), config.Settings())
    np.testing.assert_array_equal(clip.depth, recorded.depth)
    np.testing.assert_allclose(clip.gravity, recorded.gravity, atol=0.1)  # best effort: a few of its messages


def test_a_pose_that_changes_on_camera_pose_is_a_camera_that_moves(driver) -> None:
    d, failed = driver(), []
    d.node.on_failed = lambda reason, before=d.node.on_failed: (failed.append(reason), before(reason))
    d.send([info()])
    for k in range(6):
        d.publish("camera_pose", POSE, link("world", COLOUR_FRAME, CAMERA_IN_WORLD @ pose(0.02 * k), stamp_of(k)))
    d.send(colour(plain()))
    d.until(lambda: failed)
    assert "the camera moves by up to 0.1 m" in failed[0]


def test_a_yuv_camera_with_compressed_depth_is_heard_over_dds(driver) -> None:
    from tests import encoded
    from tests.filmed_cases import of_encoding

    message, deep = encoded.COLOUR["yuv422_yuy2"](), encoded.DEPTH["compressedDepth, RVL"]()
    d = driver()
    frames = of_encoding(message)
    d.send(frames[-1:])
    for k in range(3):
        head = image(stamp_of(k), plain(), "rgb8")["header"]
        d.publish("depth/compressedDepth", deep.kind, {"header": head, **deep.fields})
    d.send(frames[:-1])
    clip = d.clip()
    np.testing.assert_allclose(clip.frames[1].astype(int), message.expected.astype(int), atol=message.atol)
    np.testing.assert_allclose(clip.depth[1], deep.expected, atol=1e-6)


@pytest.mark.parametrize("stage", [SegmentNode, SplatNode, FitNode])
def test_a_stage_that_alone_is_told_of_the_world_refuses_a_clip_in_the_cameras_frame(make_node, made_clip, stage) -> None:
    camera = replace(made_clip.camera, world_from_camera=np.eye(4), world_frame_id="camera_optical")
    clip = replace(made_clip, camera=camera)
    node = make_node(stage, scene__floor_z_m=0.0)
    stamps = slot_stamps(clip)
    for name, fields in (*clip_messages(clip, stamps), *mask_messages(clip, stamps)):
        node.buffer.take(name, to_ros(TOPICS[name].type_name, fields))
    job = _elsewhere(node.buffer, None, node.parameters.settings(), "", False, "", "fit_node") if stage is FitNode else node.job()()
    with pytest.raises(InputError, match=r"scene.floor_z_m is told in the world, but the clip is in the camera's own frame camera_optical; tell it to ingest_node too"):
        list(job)


def test_a_stage_refuses_a_clip_of_another_world_than_its_own(made_clip) -> None:
    with pytest.raises(InputError, match=r"the clip is in the world world, scene.target_frame is map; tell it to ingest_node too"):
        in_world(made_clip, config.build({"scene.target_frame": "map"}))
    assert in_world(made_clip, config.build({"scene.target_frame": "/world", "scene.floor_z_m": 0.0})) is made_clip


def test_trees_of_tf_and_tf_static_make_one_chain_in_the_node(make_node) -> None:
    from diffphys_ros.bags.storage import typestore

    node, tree_message = make_node(IngestNode), typestore().types[TREE]
    node.take("/tf_static", tree_message([on_wire(POSE, link("wrist", COLOUR_FRAME, CAMERA_IN_WORLD))]))
    for k in range(3):
        node.take("/tf", tree_message([on_wire(POSE, link("world", "wrist", pose(0.1 * k), stamp_of(k)))]))
    np.testing.assert_allclose(node.beside.transforms.between("world", COLOUR_FRAME, stamp_of(1)), pose(0.1) @ CAMERA_IN_WORLD, atol=1e-9)
    assert node.beside.transforms.between("world", COLOUR_FRAME, stamp_of(100)) is None


def test_transforms_of_tf_are_heard_over_dds(driver) -> None:
    tf2 = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is in no wheel; source a ROS 2 Jazzy")
    d = driver(scene__target_frame="world")
    publishers = {topic: d.me.create_publisher(tf2.TFMessage, topic, latched() if topic == "/tf_static" else 10) for topic in ("/tf", "/tf_static")}
    d.until(lambda: all(publisher.get_subscription_count() for publisher in publishers.values()))
    publishers["/tf_static"].publish(tf2.TFMessage(transforms=[to_ros(POSE, link("wrist", COLOUR_FRAME, CAMERA_IN_WORLD))]))
    for k in range(6):
        publishers["/tf"].publish(tf2.TFMessage(transforms=[to_ros(POSE, link("world", "wrist", pose(0.1), stamp_of(k)))]))
    d.until(lambda: len(d.node.beside.transforms) == 2)
    d.send([info()])
    d.send(colour(plain()))
    np.testing.assert_allclose(d.clip().camera.world_from_camera, pose(0.1) @ CAMERA_IN_WORLD, atol=1e-9)
