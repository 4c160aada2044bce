"""Claims about malformed messages on every topic, with the nodes as real processes: nobody dies, and a good clip works afterwards."""

from __future__ import annotations

import time
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, clouds, fields, messages
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import message_class, to_ros
from diffphys_ros.nodes.listen import Listener
from diffphys_ros.nodes.qos import latched, profile, sensor
from diffphys_ros.nodes.splat_topic import LABELS, LAYOUT, splat_cloud
from diffphys_ros.splats.ply import FIELDS, from_raw
from diffphys_ros.types import Splats

from .processes import PATIENCE_S, Domain

pytestmark = pytest.mark.faults
IMAGE, INFO, POSE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/TransformStamped"
PRESSED, IMU = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Imu"
NODES = ("ingest_node", "segment_node", "splat_node", "fit_node", *(["inspect_node"] if find_spec("rerun") else []))
RAW = {"image": IMAGE, "depth": IMAGE, "mask": IMAGE, "image/compressed": PRESSED, "depth/compressedDepth": PRESSED, "camera_info": INFO, "depth_camera_info": INFO, "imu": IMU}
OTHER = {"camera_pose": POSE, "first_mask": IMAGE} | dict.fromkeys(("click", "clamp_click", "length_click"), "geometry_msgs/msg/PointStamped")
NAN = float("nan")
STAMP = 1_700_000_000_000_000_000


def malformed(type_name: str) -> Iterator[dict[str, Any]]:
    """Fields that are wrong in one way or other, of a type."""
    head = messages.header(STAMP, "camera_optical")
    yield {}
    yield {"header": {"stamp": {"sec": -5, "nanosec": 4_000_000_000}, "frame_id": "x" * 3000}}
    if type_name == IMAGE:
        good = messages.image(head, np.zeros((4, 4, 3), np.uint8), "rgb8")
        for change in ({"encoding": "nv21"}, {"encoding": "32FC1"}, {"height": 0}, {"width": 0}, {"step": 2**31}, {"height": 2**31}, {"data": b""}, {"encoding": "mono8", "step": 1}):
            yield good | change
    elif type_name.endswith("CompressedImage"):
        yield {"header": head, "format": "jpeg", "data": b"no picture"}
        yield {"header": head, "format": "x" * 3000, "data": b""}
    elif type_name == INFO:
        for change in ({"k": np.zeros(9)}, {"k": np.full(9, NAN)}, {"d": np.full(3, 0.1), "distortion_model": "plumb_bob"}, {"d": np.full(5, 1e300)}, {"distortion_model": "y" * 3000}):
            yield {"header": head, "width": 64, "height": 48, "k": np.eye(3).ravel() * 100, "d": np.zeros(5), **change}
    elif type_name == POSE:
        for w in (0.0, NAN, float("inf")):
            yield {"header": head, "child_frame_id": "camera_optical", "transform": {"rotation": {"w": w}}}
        yield {"header": head, "child_frame_id": "camera_optical", "transform": {"translation": {"x": NAN}}}
    elif type_name.endswith("PointCloud2"):
        yield from (hostile_cloud(change) for change in ({"height": 0}, {"point_step": 0}, {"point_step": 4}, {"width": 2**31}, {"fields": []}, {"data": b""}))
        yield hostile_cloud({}, scale_0=200.0)
        yield hostile_cloud({}, rot_0=0.0)
        yield clouds.pack(head, clouds.FORCE, dict.fromkeys(clouds.FORCE, np.full((2, 3), NAN)) | {"id": np.zeros((2, 3))}, (2, 3))
    elif type_name.endswith("Path"):
        yield {"header": head, "poses": [{"header": head}, {"header": head}]}
        yield {"header": head, "poses": [{"header": head}, {"header": messages.header(STAMP // 2)}]}
    elif type_name == IMU:
        yield {"header": head, "linear_acceleration": {"x": NAN, "y": 1e308, "z": float("inf")}}
    elif type_name.endswith("Vector3Stamped"):
        yield {"header": head, "vector": {"x": NAN}}
        yield {"header": head, "vector": {"z": -1e300}}
    elif type_name.endswith("PointStamped"):
        yield {"header": head, "point": {"x": NAN}}
        yield {"header": messages.header(0, "nowhere"), "point": {"x": 1e308, "y": -1e308, "z": 1e-300}}
    elif type_name.endswith("DiagnosticArray"):
        status = fields.progress(STAMP, stage="fit", loss=1.0)["status"][0]
        yield {"header": head, "status": [status | {"values": [{"key": "loss", "value": "a lot"}, {"key": "loss", "value": "1e999"}]}]}
        yield {"header": head, "status": [status | {"values": []}]}


def hostile_cloud(change: dict[str, Any], **numbers: float) -> dict[str, Any]:
    columns = dict.fromkeys(FIELDS, np.zeros(3)) | {"rot_0": np.ones(3), LABELS: np.zeros(3)} | {name: np.full(3, value) for name, value in numbers.items()}
    return clouds.pack(messages.header(STAMP, "world"), LAYOUT, columns, (1, 3)) | change


class Outside:
    """Another ROS process's place in a domain: publishes and calls services."""

    def __init__(self, domain: Domain) -> None:
        self.domain, self.context = domain, rclpy.Context()
        rclpy.init(context=self.context, domain_id=int(domain.environment["ROS_DOMAIN_ID"]))
        self.node, self.executor = rclpy.create_node("outside", context=self.context), SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.outputs: dict[str, Any] = {}

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            for name, process in self.domain.running.items():
                assert process.poll() is None, f"{name} ended with status {process.returncode}:\n{self.domain.said(name)[-3000:]}"
            assert time.monotonic() < end, "\n".join(self.domain.said(name)[-1500:] for name in self.domain.running)
            self.executor.spin_once(timeout_sec=0.05)

    def publish(self, topic: str, plain: dict[str, Any]) -> None:
        if topic not in self.outputs:
            kind = (RAW | OTHER).get(topic) or TOPICS[topic].type_name
            quality = sensor("reliable") if topic in RAW else latched() if topic in OTHER else profile(TOPICS[topic])
            self.outputs[topic] = kind, self.node.create_publisher(message_class(kind), topic.replace("~", "/fit_node", 1), quality)
            self.until(self.outputs[topic][1].get_subscription_count)
        kind, output = self.outputs[topic]
        output.publish(to_ros(kind, plain))

    def call(self, service: str) -> Any:
        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    with Domain(folder) as domain:
        for name in NODES:
            domain.node(name, **({"file": folder / "all.rrd"} if name == "inspect_node" else {"max_mib": 4}))
        for name in NODES:
            if name != "inspect_node":
                domain.await_words(name, "waiting for")
        outside = Outside(domain)
        yield outside
        outside.close()


def alive(graph: Outside) -> None:
    """Every node runs, and those that have ~/reset answer it."""
    for name in NODES:
        if name != "inspect_node":
            assert graph.call(f"/{name}/reset").message


def test_malformed_messages_on_every_topic_end_no_node_and_reset_answers(graph) -> None:
    shown = ("~/material_field", "~/force_field", "~/quality", "~/progress", "~/rendered") if "inspect_node" in NODES else ()
    clip = ("clip/camera_info", "clip/camera_pose", "clip/gravity", "clip/first_mask", "clip/image", "clip/depth", "clip/mask", "clip/end", "splats")
    for topic in (*RAW, *OTHER, *clip, *shown):
        kind = (RAW | OTHER).get(topic) or TOPICS[topic].type_name
        for plain in malformed(kind):
            graph.publish(topic, plain)
            graph.executor.spin_once(timeout_sec=0.02)  # a history of one keeps only what is heard in between
    graph.until(lambda: "topic splats: " in graph.domain.said("fit_node"))
    alive(graph)


def test_an_endless_stream_of_images_is_refused_at_the_bound(graph) -> None:
    alive(graph)
    pixels = np.zeros((256, 256, 3), np.uint8)
    names = ("segment_node", "splat_node", "fit_node")
    grown = {name: resident_mib(graph, name) for name in names}
    sent = 0

    def refused() -> bool:
        """Sends other images; whether 75 MiB are sent, of which a node keeps 4, and all have said so."""
        nonlocal sent
        for _ in range(10):
            sent += 1
            graph.publish("clip/image", messages.image(messages.header(STAMP + sent, "camera_optical"), pixels, "rgb8"))
        return sent > 400 and all("4 MiB and is dropped" in graph.domain.said(name) for name in names)

    graph.until(refused)
    alive(graph)
    for name, before in grown.items():
        assert resident_mib(graph, name) - before < 50


def resident_mib(graph: Outside, name: str) -> float:
    with open(f"/proc/{graph.domain.running[name].pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS")) / 1024


def test_after_all_that_good_splats_and_a_good_clip_begin_the_fit(graph, made_clip) -> None:
    alive(graph)
    begun: list[Any] = []
    graph.node.create_subscription(message_class(TOPICS["~/progress"].type_name), "/fit_node/progress", begun.append, profile(TOPICS["~/progress"]))
    graph.publish("splats", hostile_cloud({"height": 0}))
    stamps = slot_stamps(made_clip)
    graph.publish("splats", splat_cloud(splats(), messages.header(int(stamps[0]), "world"), zlib.crc32(made_clip.labels[0].tobytes())))
    for topic, plain in [*clip_messages(made_clip, stamps), *mask_messages(made_clip, stamps)]:
        graph.publish(topic, plain)
    graph.until(lambda: begun)
    assert graph.call("/fit_node/cancel").message


def splats() -> Splats:
    rows = np.random.default_rng(0).normal(size=(20, len(FIELDS))).astype(np.float32)
    return from_raw(rows)


def test_a_listener_hears_the_answer_after_malformed_ones(graph, made_recovery, made_clip) -> None:
    graph.call("/fit_node/reset")  # what the fit before still says does not count
    listener = Listener(graph.node, "fit_node")
    answer = fields.answer(made_recovery, made_clip, config.build({}))
    for topic in ("~/material_field", "~/force_field", "~/progress"):
        for plain in malformed(TOPICS[topic].type_name):
            graph.publish(topic, plain)
            graph.executor.spin_once(timeout_sec=0.02)
    assert "~/force_field" not in listener.received
    for topic, plain in (("~/material_field", answer.material_field()), ("~/force_field", answer.force_field()), ("~/quality", answer.quality())):
        graph.publish(topic, plain)
    graph.until(lambda: listener.complete)
    assert listener.arrays()["net_force"].shape == (len(made_clip), 3)
    assert not listener.net.faults
