"""Claims about recordings that are played: in this process, heard by another node of it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin, Writer

from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.storage import typestore
from diffphys_ros.bags.write import to_message
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, messages
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, IMAGE
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.clip_stage import CLIP
from diffphys_ros.nodes.convert import message_class, stamp_ns
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.nodes.player import Part, Player
from diffphys_ros.nodes.qos import profile

from .processes import PATIENCE_S, ROOT
from .recordings import COLOUR, INFO, NOTE, STRING, WAYS, recorded

STRANGE = "/velodyne_packets"
ODD = {"/no name": STRING, "/typeless": "os", "/relative": "/msg/x", "/no_message": "os/msg/path"}
LZ4 = "mcap, lz4 chunks"


def in_lz4(path: Path) -> Path:
    """The MCAP file of a rosbag2 folder again, as `mcap` writes it with LZ4."""
    (source,) = path.glob("*.mcap")
    with source.open("rb") as stream, (path / "lz4.mcap").open("wb") as out:
        writer, lines = McapWriter(out, compression=CompressionType.LZ4), {}
        writer.start("ros2")
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.id not in lines:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                lines[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number, channel.metadata)
            writer.add_message(lines[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    return path / "lz4.mcap"


class Hearer:
    """A node that plays and one that hears, spun together."""

    def __init__(self, domain: int) -> None:
        rclpy.init(domain_id=domain)
        self.node, self.me = rclpy.create_node("player"), rclpy.create_node("robot")
        self.executor, self.heard, self.passes = SingleThreadedExecutor(), {}, []
        self.executor.add_node(self.node)
        self.executor.add_node(self.me)

    def listen(self, topic: str, kind: str, *, latched: bool = False, reliable: bool = True) -> None:
        durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        quality = QoSProfile(depth=100, durability=durability, reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)
        self.heard[topic] = []
        self.me.create_subscription(message_class(kind), topic, lambda m: self.heard[topic].append((time.monotonic(), m)), quality)

    def play(self, path: Path, part: Part, *waited: str, **options: Any) -> Player:
        self.passes.clear()
        player = Player(self.node, path, part, ended=self.passes.append, **options)
        self.until(lambda: all(player.outputs[topic].get_subscription_count() for topic in waited))
        self.began = time.monotonic()
        player.start()
        return player

    def until(self, condition: Any) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self.executor.shutdown()
        for node in (self.node, self.me):
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def hearer(domain: int):
    one = Hearer(domain)
    yield one
    one.close()


@pytest.mark.parametrize("way", [*WAYS, LZ4])
def test_topics_bytes_and_pace_are_those_of_the_recording(hearer, made_clip, tmp_path, way):
    bag = in_lz4(recorded(tmp_path / "bag", made_clip)) if way == LZ4 else recorded(tmp_path / "bag", made_clip, way)
    hearer.listen(COLOUR, IMAGE, reliable=False)
    played: list[int] = []  # the player's time at each image [ns]
    player = hearer.play(bag, Part(rate=2.0), COLOUR, hear=lambda topic, kind, raw: played.append(player.now_ns) if topic == COLOUR else None)
    hearer.until(lambda: hearer.passes)
    hearer.until(lambda: len(hearer.heard[COLOUR]) == len(made_clip))
    for k, (_, message) in enumerate(hearer.heard[COLOUR]):
        assert stamp_ns(message) == made_clip.start_ns + round(made_clip.times[k] * 1e9)
        np.testing.assert_array_equal(np.frombuffer(message.data, np.uint8), made_clip.frames[k].ravel())
    late_s = (np.array(played) - made_clip.start_ns) * 1e-9 - made_clip.times
    assert (late_s > -1e-6).all()
    assert late_s.min() < 0.1  # a busy machine makes some late, not all
    assert hearer.heard[COLOUR][-1][0] - hearer.began > 0.49 * made_clip.times[-1]  # a busy machine hears some late, none early
    assert hearer.passes == [False]


def test_qualities_of_service_are_those_of_the_recording(hearer, made_clip, tmp_path):
    hearer.play(recorded(tmp_path / "bag", made_clip), Part())
    found = {topic: hearer.me.get_publishers_info_by_topic(topic) for topic in (COLOUR, INFO, NOTE)}
    hearer.until(lambda: found.update({t: hearer.me.get_publishers_info_by_topic(t) for t in found}) or all(found.values()))
    said = {topic: (info[0].qos_profile.reliability, info[0].qos_profile.durability) for topic, info in found.items()}
    assert said == {
        COLOUR: (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        INFO: (ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE),
        NOTE: (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
    }


def test_a_part_is_played_with_what_was_latched_before_it_and_the_clock_runs_within_it(hearer, made_clip, tmp_path):
    part = Part(rate=1.0, start_s=0.09, duration_s=0.2)
    hearer.listen(COLOUR, IMAGE, reliable=False)
    hearer.listen(NOTE, STRING, latched=True)
    hearer.listen("/clock", "rosgraph_msgs/msg/Clock")
    player = hearer.play(recorded(tmp_path / "bag", made_clip), part, COLOUR, NOTE)
    hearer.until(lambda: hearer.passes and hearer.heard[NOTE] and len(hearer.heard[COLOUR]) == 6)
    assert [stamp_ns(m) for _, m in hearer.heard[COLOUR]] == [made_clip.start_ns + round(made_clip.times[k] * 1e9) for k in range(3, 9)]

    def told() -> np.ndarray:
        return np.array([m.clock.sec * 10**9 + m.clock.nanosec for _, m in hearer.heard["/clock"]])

    hearer.until(lambda: told()[-1] >= player.end_ns)
    clock = told()
    assert (np.diff(clock) >= 0).all()
    assert player.begin_ns <= clock.min()
    assert clock.max() == player.end_ns
    assert len(clock) > 3


def test_a_loop_starts_over_until_it_is_stopped(hearer, made_clip, tmp_path):
    heard: list[int] = []
    player = hearer.play(recorded(tmp_path / "bag", made_clip), Part(rate=10.0, loop=True), hear=lambda topic, kind, raw: heard.append(len(raw)) if topic == COLOUR else None)
    hearer.until(lambda: len(hearer.passes) == 3)
    player.stop()
    assert hearer.passes == [True] * 3
    assert len(heard) >= 3 * len(made_clip)


def test_topics_of_types_that_are_not_installed_are_named_and_the_others_play(hearer, made_clip, tmp_path):
    bag = recorded(tmp_path / "bag", made_clip)
    with Writer(tmp_path / "strange", version=9) as writer:
        line = writer.add_connection(STRANGE, "velodyne_msgs/msg/VelodynePacket", msgdef="builtin_interfaces/Time stamp\n", rihs01="RIHS01_0")
        writer.write(line, made_clip.start_ns, bytes(12))
        for topic, kind in ODD.items():
            line = writer.add_connection(topic, kind, msgdef="string data\n", rihs01="RIHS01_0")
            writer.write(line, made_clip.start_ns, bytes(12))
    player = Player(hearer.node, tmp_path / "strange", Part())
    assert player.unknown == {STRANGE: "velodyne_msgs/msg/VelodynePacket"} | ODD
    assert Player(hearer.node, bag, Part()).outputs.keys() >= {COLOUR, INFO, NOTE}


@pytest.mark.parametrize(("part", "words"), [(Part(start_s=9.0), "start 9 s lies behind its end, it lasts 0.3667 s")])
def test_a_part_that_the_recording_does_not_have_is_refused(hearer, made_clip, tmp_path, part, words):
    with pytest.raises(InputError, match=words):
        Player(hearer.node, recorded(tmp_path / "bag", made_clip), part)


def test_pictures_are_no_recording_that_can_be_played(hearer, tmp_path):
    with pytest.raises(InputError, match="is no recording, which alone can be played"):
        Player(hearer.node, tmp_path, Part())


def test_ingest_node_hears_what_it_plays_as_if_a_camera_sent_it(make_node, made_clip, tmp_path):
    bag = recorded(tmp_path / "bag", made_clip)
    node = make_node(IngestNode, bag=bag, rate=5.0, start=0.05)
    executor, me, buffer = SingleThreadedExecutor(), rclpy.create_node("stage"), ClipBuffer()
    for each in (node, me):
        executor.add_node(each)
    for name in CLIP:
        me.create_subscription(message_class(TOPICS[name].type_name), name, lambda m, n=name: buffer.take(n, m), profile(TOPICS[name]))
    end = time.monotonic() + PATIENCE_S
    while buffer.missing(masks=False):
        assert time.monotonic() < end, node.state
        executor.spin_once(timeout_sec=0.02)
    clip, read = buffer.clip(), read_clip(bag, Settings(), start_s=0.05)
    executor.shutdown()
    me.destroy_node()
    np.testing.assert_array_equal(clip.frames, made_clip.frames[2:])
    np.testing.assert_array_equal(clip.frames, read.frames)
    np.testing.assert_array_equal(clip.camera.world_from_camera, read.camera.world_from_camera)
    assert (clip.start_ns, clip.camera.world_frame_id) == (read.start_ns, "world")


def test_a_bad_message_of_a_recording_costs_itself(make_node, made_clip, tmp_path):
    node = make_node(IngestNode, bag=recorded(tmp_path / "bag", made_clip, bad=4), rate=20.0)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + PATIENCE_S
    while node.state != "done":
        assert time.monotonic() < end, node.state
        executor.spin_once(timeout_sec=0.02)
    executor.shutdown()
    assert node.collected == len(made_clip) - 1
    assert (node.net.refused, node.net.faults) == (2, 0)


def test_a_recording_that_has_ended_is_not_waited_for(make_node, made_clip, tmp_path):
    node = make_node(IngestNode, bag=recorded(tmp_path / "bag", made_clip), rate=20.0)
    assert node.waiting_for().startswith("/")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + PATIENCE_S
    while not (node.state == "done" and node.player.over):
        assert time.monotonic() < end, node.state
        executor.spin_once(timeout_sec=0.02)
    assert node.waiting_for() == ""
    node.trigger_deactivate()
    node.trigger_activate()
    executor.shutdown()
    assert node.waiting_for() == ""


def test_a_node_that_is_deactivated_while_it_plays_begins_again_when_it_is_active(make_node, made_clip, tmp_path):
    node = make_node(IngestNode, bag=recorded(tmp_path / "bag", made_clip), loop=True, rate=2.0)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    for _ in range(2):
        before, end = node.collected, time.monotonic() + PATIENCE_S
        while node.collected < before + 3:
            assert time.monotonic() < end, node.state
            executor.spin_once(timeout_sec=0.02)
        assert {topic: node.count_publishers(topic) for topic in node.player.outputs} == dict.fromkeys(node.player.outputs, 1)
        assert node.trigger_deactivate() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    executor.shutdown()
    assert node.net.faults == 0


def test_a_part_without_images_is_said_to_hold_none(make_node, made_clip, tmp_path):
    said: list[str] = []
    node = make_node(IngestNode, bag=recorded(tmp_path / "bag", made_clip), rate=50.0, start=0.001, duration=0.002)
    node.on_failed = said.append
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    end = time.monotonic() + PATIENCE_S
    while not said:
        assert time.monotonic() < end
        executor.spin_once(timeout_sec=0.02)
    executor.shutdown()
    assert "no image was played; choose another start and duration" in said[0]
    assert node.state == "failed"


STREAM = """
import resource, sys
from pathlib import Path
from diffphys_ros.bags.storage import open_bag
with open_bag(Path(sys.argv[1])) as bag:
    sizes = []
    for _, _, raw in bag.raw(list(bag.types)):
        sizes.append(len(raw))
        if len(sizes) == 20:
            early = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(sum(sizes) / 2**20, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - early) / 1024)
"""


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_recording_is_read_as_it_is_played_and_never_held_as_a_whole(tmp_path, plugin):
    pixels, store = np.zeros((480, 640, 3), np.uint8), typestore()
    with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        line = writer.add_connection("/image", IMAGE, typestore=store)
        raw = store.serialize_cdr(to_message(IMAGE, messages.image(messages.header(1), pixels, "rgb8")), IMAGE)
        for k in range(120):
            writer.write(line, k + 1, raw)
    done = subprocess.run(
        [sys.executable, "-c", STREAM, str(tmp_path / "bag")], env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    read_mib, grown_mib = map(float, done.stdout.split())
    assert read_mib > 100
    assert grown_mib < 20


def test_a_message_is_published_as_the_bytes_that_were_recorded(hearer, made_clip, tmp_path):
    kept: list[bytes] = []
    hearer.listen(INFO, CAMERA_INFO)
    hearer.play(recorded(tmp_path / "bag", made_clip), Part(rate=10.0), INFO, hear=lambda topic, kind, raw: kept.append(raw) if topic == INFO else None)
    hearer.until(lambda: len(hearer.heard[INFO]) == len(made_clip))
    assert [serialize_message(m)[4:] for _, m in hearer.heard[INFO]] == [raw[4:] for raw in kept]
