"""Claims about a recording that ingest_node plays: it gives the very clip that reading it gives, with the geometry beside the images."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rclpy.executors import SingleThreadedExecutor

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import TOPICS
from diffphys_ros.nodes.camera_bag import inputs
from diffphys_ros.nodes.clip_buffer import ClipBuffer
from diffphys_ros.nodes.convert import to_ros
from diffphys_ros.nodes.ingest_node import IngestNode
from diffphys_ros.types import Clip
from tests import encoded
from tests.filmed import COLOUR_FRAME, ROLES, Message, colour, imu, info
from tests.filmed_cases import CASES, depth_camera, in_world, of_depth_encoding, plain

from .processes import PATIENCE_S
from .test_live_geometry import assert_same

GEOMETRY = [name for name in CASES if "encoding" not in name]


class Played(IngestNode):
    """Keeps the clip that it publishes, with what is said of it."""

    def __init__(self) -> None:
        self.buffer, self.out, self.failures = ClipBuffer(), None, []
        super().__init__()

    def send(self, name: str, fields: Any) -> None:
        super().send(name, fields)
        if name.startswith("clip/"):
            self.buffer.take(name, to_ros(TOPICS[name].type_name, fields))

    def on_done(self, sent) -> None:
        super().on_done(sent)
        self.out = replace(self.buffer.clip(), notes=tuple(sent.notes))

    def on_failed(self, reason: str) -> None:
        super().on_failed(reason)
        self.failures.append(reason)


def played(node: Played) -> Clip:
    executor, end = SingleThreadedExecutor(), time.monotonic() + PATIENCE_S
    executor.add_node(node)
    while node.out is None:
        assert time.monotonic() < end, node.waiting_for()
        assert not node.failures
        executor.spin_once(timeout_sec=0.02)
    executor.shutdown()
    return node.out


def recording(path: Path, messages: list[Message]) -> Path:
    """In the order of their times; what stands still is told first, as a driver does."""
    return write_recording(path, sorted(messages, key=lambda message: message[2]))


@pytest.mark.parametrize("name", GEOMETRY)
def test_a_recording_that_is_played_gives_the_clip_that_reading_it_gives(make_node, tmp_path: Path, name: str) -> None:
    messages, given = CASES[name]()
    bag = recording(tmp_path / "clip.mcap", messages)
    node = make_node(Played, bag=bag, rate=4.0, **{key.replace(".", "__"): value for key, value in given.items()})
    assert_same(played(node), read_clip(bag, config.build(given)))


@pytest.mark.parametrize(
    ("messages", "roles"),
    [
        (depth_camera(), {"/color/image_raw", "/color/camera_info", "/depth/image_raw", "/depth/camera_info"}),
        ([*in_world(), *imu((0.0, -9.8, 0.0), COLOUR_FRAME)], {"/color/image_raw", "/color/camera_info", "/tf", "/imu"}),
        (of_depth_encoding(encoded.DEPTH["compressedDepth, RVL"]()), {"/color/image_raw", "/color/camera_info", "/depth/image_raw/compressedDepth"}),
    ],
    ids=["depth camera", "tf and imu", "compressed depth"],
)
def test_what_stands_beside_the_images_is_taken_by_the_names_of_the_node(tmp_path: Path, messages: list[Message], roles: set[str]) -> None:
    assert inputs(recording(tmp_path / "clip.mcap", messages), Topics()) == {topic: ROLES[topic] for topic in roles}


def test_an_imu_is_left_out_where_none_is_wanted_and_refused_where_it_is_not_there(tmp_path: Path) -> None:
    bag = recording(tmp_path / "clip.mcap", [*colour(plain()), info(), *imu((0.0, -9.8, 0.0), COLOUR_FRAME)])
    assert "/imu" not in inputs(bag, Topics(imu="none"))
    with pytest.raises(InputError, match=r"topics\.imu is '/other'"):
        inputs(bag, Topics(imu="/other"))
