"""Claims about inspect_node, in this process."""

from __future__ import annotations

import socket
import time
import urllib.request
from contextlib import suppress
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from diffphys_ros import config
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS, fields
from diffphys_ros.nodes.clip_topics import clip_messages, slot_stamps
from diffphys_ros.nodes.convert import message_class, to_ros
from diffphys_ros.nodes.inspect_node import InspectNode, unused
from diffphys_ros.nodes.qos import profile
from diffphys_ros.progress import ForceSoFar

from .processes import PATIENCE_S

pytest.importorskip("rerun", reason="rerun-sdk is not installed")


class Teller:
    """Publishes to an inspect_node as the other nodes do, spun together with it."""

    def __init__(self, node: InspectNode) -> None:
        self.node, self.me, self.outputs = node, rclpy.create_node("teller"), {}
        self.executor = SingleThreadedExecutor()
        for each in (node, self.me):
            self.executor.add_node(each)

    def until(self, condition) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end, self.node.shown
            self.executor.spin_once(timeout_sec=0.02)

    def tell(self, name: str, plain) -> None:
        topic = TOPICS[name]
        if name not in self.outputs:
            self.outputs[name] = self.me.create_publisher(message_class(topic.type_name), name.replace("~", "/fit_node"), profile(topic))
            self.until(self.outputs[name].get_subscription_count)
        before = self.node.received
        self.outputs[name].publish(to_ros(topic.type_name, plain))
        self.until(lambda: self.node.received > before)

    def tell_clip(self, clip) -> None:
        for name, plain in clip_messages(clip, slot_stamps(clip)):
            if name in ("clip/camera_info", "clip/camera_pose", "clip/image"):
                self.tell(name, plain)


@pytest.fixture
def teller(make_node):
    made = []

    def make(**parameters) -> Teller:
        made.append(Teller(make_node(InspectNode, **parameters)))
        return made[-1]

    yield make
    for each in made:
        each.executor.shutdown()
        each.me.destroy_node()


def test_a_start_and_another_clip_keep_the_recordings_before_them(teller, made_clip, tmp_path):
    path = tmp_path / "all.rrd"
    path.write_bytes(b"kept")
    t = teller(file=path)
    t.tell_clip(made_clip)
    assert t.node.images == len(made_clip)
    t.tell_clip(made_clip)
    assert t.node.images == len(made_clip)
    assert path.read_bytes() == b"kept"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["all.rrd", "all_2.rrd", "all_3.rrd"]
    assert (tmp_path / "all_2.rrd").stat().st_size > 10_000


def test_loss_and_fields_are_shown_while_they_come(teller, made_recovery, made_clip, tmp_path):
    t = teller(file=tmp_path / "all.rrd")
    t.tell_clip(made_clip)
    t.tell("~/progress", fields.progress(1, stage="fit", iteration=0, iterations=3, loss=0.5))
    t.tell("~/force_so_far", fields.force_so_far(ForceSoFar(made_clip.start_ns, made_clip.period_s, "world", (0.0, 0.0, 0.0), 4e-5, ((0.0, 0.0, 1.5),) * 12, 0.1, density_told=True, length_told=True)))
    answer = fields.answer(made_recovery, made_clip, config.build({}))
    for name in ("~/material_field", "~/force_field"):
        t.tell(name, getattr(answer, name[2:])())
    assert t.node.shown >= {"clip/image", "~/progress", "~/force_so_far", "~/material_field", "~/force_field"}
    assert not t.node.net.refused


def test_a_device_is_written_to_as_it_is():
    assert unused(Path("/dev/null")) == Path("/dev/null")
    assert not Path("/dev/null_2").exists()


def test_a_folder_that_cannot_be_written_is_refused(make_node):
    with pytest.raises(InputError, match=r"file /proc/nowhere/all\.rrd: cannot be written"):
        make_node(InspectNode, file="/proc/nowhere/all.rrd")


def two_free_ports() -> int:
    """The first of two."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("0.0.0.0", 0))
            port = first.getsockname()[1]
            with suppress(OSError, OverflowError):
                second.bind(("0.0.0.0", port + 1))
                return port


@pytest.mark.parametrize("which", [0, 1], ids=["of the viewer", "of its data"])
def test_a_port_that_is_taken_is_refused_by_its_number(make_node, which):
    with socket.socket() as other:
        other.bind(("0.0.0.0", port := two_free_ports() + which))
        other.listen()
        with pytest.raises(InputError, match=f"web_port: port {port} cannot be opened .*choose a web_port that is free"):
            make_node(InspectNode, viewer="web", web_port=port - which)


def test_a_web_browser_is_served_a_viewer(teller, made_clip):
    t = teller(viewer="web", web_port=two_free_ports())
    t.tell_clip(made_clip)
    with urllib.request.urlopen(t.node.web.url, timeout=20) as page:
        assert b"Rerun SDK-bundled web viewer" in page.read()
