"""Hostile messages on every topic that a node takes, through the callbacks that rclpy would call, and a good clip after them."""

from __future__ import annotations

import os
import time
import zlib
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "OFF"  # what these nodes publish is nobody's business

import numpy as np
import rclpy
from std_srvs.srv import Trigger

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, clouds, fields, messages
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_topics import clip_messages, mask_messages, slot_stamps
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.fit_node import FitNode
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.inspect_node import InspectNode
from diffphys_ros.nodes.intake import Intake
from diffphys_ros.nodes.limits import MIB
from diffphys_ros.nodes.listen import HEARD, Listener
from diffphys_ros.nodes.segment_node import CLICK, FIRST_MASK, SegmentNode
from diffphys_ros.nodes.splat_node import SplatNode
from diffphys_ros.nodes.splat_topic import splat_cloud
from diffphys_ros.splats import ply
from diffphys_ros.types import Camera, Clip

if find_spec("rerun") is not None:
    import diffphys_ros.report.rerun_log  # noqa: F401 - early: it takes address space of which a case has little

from .pictures import ENCODINGS, FORMATS, NUMBERS, SIZES, check_splats, hostile_rows, pick, picture, raw_rows, spoiled

COUNT = 25_000
FRAMES, HEIGHT, WIDTH = 5, 6, 8
START_NS, PERIOD_NS, NEXT_NS = 1_700_000_000_000_000_000, 33_333_333, 20_000_000_000
MAX_MIB, MAX_FRAMES = 1, 40
WAIT_S = 8.0
STAMPS = (0, -1, 1, 2**31 - 1, -(2**31), START_NS // 10**9, START_NS // 10**9 + 1)
FRAMES_OF = ("", "world", "camera_optical", "/", "a b", "\n", "é" * 60, "x" * 5000)
IMAGE, PRESSED, INFO, TRANSFORM = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo", "geometry_msgs/msg/TransformStamped"
IMU = "sensor_msgs/msg/Imu"
RAW = {
    "image": IMAGE, "image/compressed": PRESSED, "depth": IMAGE, "depth/compressedDepth": PRESSED, "mask": IMAGE,
    "camera_info": INFO, "depth_camera_info": INFO, "camera_pose": TRANSFORM, "imu": IMU,
}  # fmt: skip
Said = tuple[str, Any]  # topic, rclpy message


def case(seed: int, folder: Path) -> str:
    """A few hostile messages to one node; then it must answer ~/reset or, without that, take a good clip."""
    rng = np.random.default_rng(seed)
    rig = rigs()[int(rng.integers(len(rigs())))]
    rig.begin()
    refused, failures = rig.net.refused, rig.failures
    rig.hear(rng, list(hostile(rng, rig)))
    rig.settle()
    if rig.good is not None:
        if rng.random() < 0.5:
            rig.reset()
        rig.good(rig, rng)
    rig.look()
    return "refused" if rig.net.refused > refused or rig.failures > failures else "taken"


@dataclass
class Rig:
    """A node of this process, and what it was told."""

    node: Any
    net: Any
    callbacks: dict[str, Callable[..., Any]]
    types: dict[str, str]
    informed: bool = False  # callbacks take a message and what rclpy knows about it
    good: Callable[[Rig, np.random.Generator], None] | None = None
    clips: list[Clip] = field(default_factory=list)
    failures: int = 0
    now_ns: int = 10**18  # when the next message is sent
    start_ns: int = START_NS

    def begin(self) -> None:
        """As it was before any message, so that a case comes from its seed alone."""
        self.start_ns, self.clips = START_NS, []
        if isinstance(self.node, IngestNode):
            self.node.intake = self.node.recorder.intake = Intake(MAX_FRAMES, MAX_MIB * MIB)
            self.node.recorder.reset()
            self.node.dispatch.release()
        elif self.good is not None:
            self.reset()
        elif isinstance(self.node, InspectNode):
            self.node.camera_from = {}

    def hear(self, rng: np.random.Generator, said: Sequence[Said]) -> None:
        """Call back as rclpy would."""
        for topic, message in said:
            self.now_ns += 10**6
            about = ({"source_timestamp": self.now_ns, "received_timestamp": self.now_ns},) if self.informed and topic not in (CLICK, FIRST_MASK, "splats") else ()
            self.callbacks[topic](message, *about)

    def settle(self) -> None:
        """Wait for the worker, and look that the program made no error."""
        until = time.monotonic() + WAIT_S
        while getattr(self.node, "worker", None) is not None and self.node.worker.busy:
            self.node._poll()
            assert time.monotonic() < until, "the worker does not end"
            time.sleep(2e-4)
        self.look()

    def look(self) -> None:
        """Raises AssertionError where there was an error of the program, or a sentence is none."""
        if isinstance(self.node, SegmentNode | IngestNode):
            self.node._diagnose()
        faults, self.net.faults = self.net.faults, 0
        assert not faults, self.net.last_fault
        assert self.net.last.isprintable(), repr(self.net.last)

    def reset(self) -> None:
        """~/reset, which always answers; ingest_node may say that it is busy."""
        service = next(s for s in self.node.services if s.srv_name.endswith("/reset"))
        assert service.callback(Trigger.Request(), Trigger.Response()).success


@lru_cache
def rigs() -> list[Rig]:
    """The nodes, made once; their jobs end with the clip."""
    given = [f"{name}:max_mib:={MAX_MIB}" for name in ("segment_node", "splat_node", "fit_node", "ingest_node")]
    given.append("ingest_node:patience_s:=0.0")
    words = [word for parameter in (*given, f"inspect_node:file:={os.devnull}") for word in ("-p", parameter)]
    rclpy.init(args=["--ros-args", *words, "--log-level", "fatal"])
    made = [_stage(SegmentNode, _good_clip), _stage(SplatNode, _good_clip), _stage(FitNode, _good_clip), _ingest()]
    if find_spec("rerun") is not None:
        node = InspectNode()
        made.append(Rig(node, node.net, _callbacks(node), _types(node)))
    person = rclpy.create_node("robot")
    listener = Listener(person, "fit_node")
    listener.say = lambda text: None  # type: ignore[method-assign]
    made.append(Rig(person, listener.net, _callbacks(person), {t: TOPICS[t].type_name for t in HEARD}))
    return made


def _callbacks(node: Any) -> dict[str, Callable[..., Any]]:
    return {_name(s.topic_name): s.callback for s in node.subscriptions if _name(s.topic_name) in {*TOPICS, *RAW, CLICK, FIRST_MASK}}


def _types(node: Any) -> dict[str, str]:
    kinds = {**RAW, CLICK: "geometry_msgs/msg/PointStamped", FIRST_MASK: IMAGE}
    return {name: TOPICS[name].type_name if name in TOPICS else kinds[name] for name in _callbacks(node)}


def _name(topic: str) -> str:
    return topic.replace("/fit_node/", "~/").removeprefix("/") if "/fit_node/" in topic else topic.removeprefix("/")


def _stage(kind: type, good: Callable[[Rig, np.random.Generator], None]) -> Rig:
    class Short(kind):  # type: ignore[misc]
        """Assembles the clip and leaves the work."""

        def job(self) -> Any:
            buffer, splats = self.buffer.copy(), getattr(self, "splats", None)

            def assemble() -> Generator[None, None, Clip]:
                yield
                if splats is not None:
                    check_splats(splats[buffer.id].splats)
                return buffer.clip()

            return assemble

        def on_news(self, news: Any) -> None:
            pass

        def on_done(self, clip: Clip) -> None:
            check_clip(clip)
            rig.clips.append(clip)

        def on_failed(self, reason: str) -> None:
            rig.failures += 1
            assert 0 < len(reason) < 700, reason

    node = Short()
    rig = Rig(node, node.net, _callbacks(node), _types(node), informed=True, good=good)
    return rig


def _ingest() -> Rig:
    class Short(IngestNode):
        """Makes the messages of the clip and keeps them."""

        def send(self, name: str, fields: Any) -> None:
            if name.startswith("clip/"):
                sent.append((name, to_ros(TOPICS[name].type_name, fields)))

        def on_done(self, result: Any) -> None:
            buffer = ClipBuffer()
            while sent:
                buffer.take(*sent.pop(0))
            assert not buffer.missing(masks=False)
            try:
                rig.clips.append(buffer.clip())
            except InputError:
                return  # images that make no clip, such as depth that is nowhere known
            check_clip(rig.clips[-1])

        def on_failed(self, reason: str) -> None:
            super().on_failed(reason)
            sent.clear()
            rig.failures += 1
            assert 0 < len(reason) < 700, reason

    sent: list[Said] = []
    node = Short()
    rig = Rig(node, node.net, _callbacks(node), _types(node), good=_good_camera)
    return rig


def check_clip(clip: Clip) -> None:
    """That a clip is whole."""
    count, height, width, channels = clip.frames.shape
    assert count >= 2
    assert (clip.frames.dtype, channels, height, width) == (np.uint8, 3, clip.camera.height, clip.camera.width)
    assert np.isfinite(clip.period_s)
    assert clip.period_s > 0
    assert np.isfinite(clip.camera.pixel_from_camera).all()
    assert np.isfinite(clip.camera.world_from_camera).all()
    for images in (clip.depth, clip.labels):
        assert images is None or (images.shape == (count, height, width) and np.isfinite(images).all())


@lru_cache
def _clip() -> Clip:
    rng = np.random.default_rng(3)
    camera = Camera(np.array([[9.0, 0, 3.5], [0, 9.0, 2.5], [0, 0, 1]]), np.eye(4), WIDTH, HEIGHT, "camera_optical", "camera_optical")
    frames = rng.integers(100, 120, (FRAMES, HEIGHT, WIDTH, 3), dtype=np.uint8)
    labels = np.zeros((FRAMES, HEIGHT, WIDTH), np.uint8)
    labels[:, 2:4, 2:6] = 1
    return Clip(frames, START_NS, PERIOD_NS * 1e-9, camera, np.full(labels.shape, 0.5, np.float32), labels)


def good_clip(rng: np.random.Generator, start_ns: int) -> Clip:
    """A clip like any other, later than those before."""
    clip = replace(_clip(), start_ns=start_ns)
    return clip if rng.random() < 0.5 else replace(clip, depth=None)


def said_of(clip: Clip) -> list[Said]:
    """The messages of a clip and its masks."""
    stamps = slot_stamps(clip)
    plain = [*clip_messages(clip, stamps), *mask_messages(clip, stamps)]
    return [(topic, to_ros(TOPICS[topic].type_name, what)) for topic, what in plain]


def splats_at(stamp_ns: int) -> Any:
    """A good cloud of Gaussians."""
    return to_ros(TOPICS["splats"].type_name, splat_cloud(ply.from_raw(raw_rows()), messages.header(stamp_ns, "world"), zlib.crc32(_clip().labels[0].tobytes())))  # type: ignore[index]


def _good_clip(rig: Rig, rng: np.random.Generator) -> None:
    rig.start_ns += NEXT_NS
    clip = good_clip(rng, rig.start_ns)
    said = [word for word in said_of(clip) if word[0] in rig.callbacks]
    if "splats" in rig.callbacks:
        said.append(("splats", splats_at(clip.start_ns)))
    before = len(rig.clips)
    rig.hear(rng, said)
    rig.settle()
    assert len(rig.clips) > before, f"a good clip was not taken; waiting for {rig.node.waiting_for()!r}, {rig.node.state}, {rig.net.last}"
    alone = rig.node.buffer.first_alone
    np.testing.assert_array_equal(rig.clips[-1].frames[: 1 if alone else None], clip.frames[: 1 if alone else None])
    rig.clips.clear()


def _good_camera(rig: Rig, rng: np.random.Generator) -> None:
    rig.reset()
    rig.start_ns += NEXT_NS
    clip = good_clip(rng, rig.start_ns)
    names = {"clip/image": "image", "clip/depth": "depth", "clip/camera_info": "camera_info"}
    before = len(rig.clips)
    rig.hear(rng, [(names[topic], message) for topic, message in said_of(clip) if topic in names])
    rig.node._on_end(Trigger.Request(), Trigger.Response())
    rig.settle()
    assert len(rig.clips) > before, f"a good clip was not taken; {rig.node.state}, {rig.net.last}"
    np.testing.assert_array_equal(rig.clips[-1].frames, clip.frames)
    rig.node.recorder.reset()
    rig.clips.clear()


def hostile(rng: np.random.Generator, rig: Rig) -> Iterator[Said]:
    """A clip with some messages spoiled, lost, doubled or out of order; or messages of no clip at all."""
    said: list[Said] = []
    if rig.informed and rng.random() < 0.7:
        said = [word for word in said_of(good_clip(rng, rig.start_ns)) if word[0] in rig.callbacks]
    elif rng.random() < 0.7:
        said = [(topic, _valid(rng, topic, rig)) for topic in rig.callbacks for _ in range(int(rng.integers(1, 4)))]
    if rng.random() < 0.3:
        rng.shuffle(said)  # type: ignore[arg-type]
    for topic, message in said:
        chance = rng.random()
        if chance < 0.05:
            continue
        yield topic, spoilt(rng, message) if chance < 0.25 else message
        if chance > 0.95:
            yield topic, message
    for _ in range(int(rng.integers(4))):
        topic = pick(rng, list(rig.callbacks))
        yield topic, spoilt(rng, _valid(rng, topic, rig))


def _valid(rng: np.random.Generator, topic: str, rig: Rig) -> Any:
    kind = rig.types[topic]
    clip, at = _clip(), rig.start_ns + int(rng.integers(FRAMES)) * PERIOD_NS
    head = messages.header(at, "camera_optical")
    make: dict[str, Callable[[], Any]] = {
        IMAGE: lambda: _image(rng, topic, head),
        PRESSED: lambda: {"header": head, "format": pick(rng, FORMATS), "data": picture(rng)},
        INFO: lambda: messages.camera_info(head, clip.camera),
        TRANSFORM: lambda: messages.camera_pose(at, clip.camera),
        IMU: lambda: {"header": head, "linear_acceleration": {"y": -9.8}},
        "geometry_msgs/msg/Vector3Stamped": lambda: messages.gravity(at, clip.camera, pick(rng, (None, np.array([0.0, 0.0, -9.8])))),
        "geometry_msgs/msg/PointStamped": lambda: {"header": head, "point": {"x": 3.0, "y": 2.0, "z": 0.0}},
        "geometry_msgs/msg/WrenchStamped": lambda: {"header": head},
        "nav_msgs/msg/Path": lambda: messages.camera_path([at + k * PERIOD_NS for k in range(FRAMES)], clip.camera),
        "diagnostic_msgs/msg/DiagnosticArray": lambda: fields.progress(at, stage="fit", iteration=3, iterations=9, loss=0.5, seconds_left=2.0),
        "sensor_msgs/msg/PointCloud2": lambda: _cloud(rng, topic, head),
    }
    return to_ros(kind, make[kind]())


def _image(rng: np.random.Generator, topic: str, head: dict[str, Any]) -> dict[str, Any]:
    if topic.endswith("mask"):
        return messages.image(head, _clip().labels[0], "mono8")  # type: ignore[index]
    if topic.endswith("depth"):
        return messages.image(head, np.full((HEIGHT, WIDTH), 0.5, np.float32), "32FC1")
    return messages.image(head, _clip().frames[0], "rgb8")


def _cloud(rng: np.random.Generator, topic: str, head: dict[str, Any]) -> dict[str, Any]:
    if topic == "splats":
        rows = hostile_rows(rng)
        return clouds.pack(head, dict.fromkeys(ply.FIELDS, ""), dict(zip(ply.FIELDS, rows.T, strict=True)), (1, len(rows)))
    layout = clouds.MATERIAL if topic.endswith("material_field") else clouds.FORCE
    shape = (1, 6) if layout is clouds.MATERIAL else (3, 6)
    return clouds.pack(head, layout, {name: rng.integers(1, 5, shape) for name in layout}, shape)


def spoilt(rng: np.random.Generator, message: Any) -> Any:
    """The message with something in it that may be wrong, of a kind that the wire can carry."""
    message = type(message)(**{name: getattr(message, name) for name in message.get_fields_and_field_types()})
    if hasattr(message, "header") and rng.random() < 0.3:
        message.header = to_ros("std_msgs/msg/Header", messages.header(0, pick(rng, FRAMES_OF)))
        message.header.stamp.sec, message.header.stamp.nanosec = int(pick(rng, STAMPS)), int(pick(rng, (0, 1, 999_999_999, 2**32 - 1)))
        return message
    name = pick(rng, [n for n in message.get_fields_and_field_types() if n != "header"])
    kind = message.get_fields_and_field_types()[name]
    with suppress(AssertionError):  # where rclpy checks fields, it holds the message to what the wire can carry
        setattr(message, name, _odd(rng, kind, name, getattr(message, name)))
    return message


def _odd(rng: np.random.Generator, kind: str, name: str, value: Any) -> Any:
    if kind == "string":
        return pick(rng, (*ENCODINGS, *FORMATS, *FRAMES_OF, "nan", "1e999", "plumb_bob", "equidistant", "fisheye"))
    if kind in ("uint32", "int32", "uint8", "uint16"):
        bits = int(kind.removeprefix("u").removeprefix("int"))
        return int(pick(rng, SIZES)) % 2 ** (bits - (not kind.startswith("u")))
    if kind in ("double", "float"):
        return float(pick(rng, NUMBERS))
    if kind == "boolean":
        return bool(rng.integers(2))
    if kind == "sequence<uint8>":
        return bytes(600_000) if rng.random() < 0.03 else spoiled(rng, bytes(value)) if len(value) else b""
    if kind == "octet":
        return bytes([int(rng.integers(256))])
    if kind.startswith("sequence<double") or kind.startswith("double["):
        count = len(value) if kind.startswith("double[") else int(pick(rng, (0, 1, 3, 4, 5, 6, 8, 12, 14, 100)))
        numbers = np.resize(np.asarray(value, float) if len(value) else np.full(1, 0.1), count)
        if count:
            numbers[rng.integers(0, count, 2)] = pick(rng, (*NUMBERS, 0.1, 1e6))
        return np.zeros(count) if rng.random() < 0.2 else numbers
    if kind.startswith("sequence<"):
        items = list(value)
        if not items or rng.random() < 0.2:
            return []
        at = int(rng.integers(len(items)))
        if rng.random() < 0.3:
            return [*items, items[at]] if rng.random() < 0.5 else items[:at]
        items[at] = spoilt(rng, items[at])
        return items
    if "/" in kind:
        return spoilt(rng, value)
    raise AssertionError(f"no way to spoil {kind} {name}")
