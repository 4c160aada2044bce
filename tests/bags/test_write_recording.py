"""Recordings that ros2 bag play can play."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.rosbag2 import Reader

from diffphys_ros.bags.write import to_message, write_recording
from diffphys_ros.errors import InputError

HEAD = {"stamp": {"sec": 7, "nanosec": 8}, "frame_id": "world"}
CLOUD = {
    "header": HEAD,
    "height": 1,
    "width": 2,
    "fields": [{"name": "x", "offset": 0, "datatype": 7, "count": 1}],
    "point_step": 4,
    "row_step": 8,
    "data": np.array([1.5, -2.5], np.float32).tobytes(),
    "is_dense": True,
}
STATUS = {"header": HEAD, "status": [{"level": b"\x01", "name": "part 1", "values": [{"key": "young_modulus", "value": "1e5"}]}]}
MESSAGES = [
    ("/fit/material", "sensor_msgs/msg/PointCloud2", 10, CLOUD, True),
    ("/fit/quality", "diagnostic_msgs/msg/DiagnosticArray", 10, STATUS, True),
    ("/fit/net_force", "geometry_msgs/msg/WrenchStamped", 20, {"header": HEAD, "wrench": {"force": {"x": np.float32(1.5)}}}, False),
    ("/fit/net_force", "geometry_msgs/msg/WrenchStamped", 30, {"header": HEAD, "wrench": {"force": {"x": 2.5}}}, False),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_recording(tmp_path / "recovery.mcap", MESSAGES)


def test_another_reader_sees_the_same_values(path: Path) -> None:
    seen = [(m.channel.topic, m.log_time_ns, m.ros_msg) for m in read_ros2_messages(path)]
    assert [(topic, ns) for topic, ns, _ in seen] == [(m[0], m[2]) for m in MESSAGES]
    cloud, status, *wrenches = (message for _, _, message in seen)
    assert np.frombuffer(bytes(cloud.data), np.float32).tolist() == [1.5, -2.5]
    assert (cloud.fields[0].name, cloud.header.frame_id, cloud.header.stamp.nanosec) == ("x", "world", 8)
    assert (status.status[0].level, status.status[0].values[0].value) == (1, "1e5")
    assert [w.wrench.force.x for w in wrenches] == [1.5, 2.5]


def test_the_file_carries_what_the_player_needs(path: Path) -> None:
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary, metadata = reader.get_summary(), list(reader.iter_metadata())
        assert reader.get_header().profile == "ros2"
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(MESSAGES)
    assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
    assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
    info = yaml.safe_load(next(m for m in metadata if m.name == "rosbag2").metadata["serialized_metadata"])
    assert (info["version"], info["message_count"], info["relative_file_paths"]) == (9, 4, ["recovery.mcap"])


def test_latched_topics_are_offered_transient_local_with_depth_one(path: Path) -> None:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    offered = {c.topic: yaml.safe_load(c.metadata["offered_qos_profiles"])[0] for c in summary.channels.values()}
    assert (offered["/fit/material"]["durability"], offered["/fit/material"]["depth"]) == ("transient_local", 1)
    assert offered["/fit/net_force"]["durability"] == "volatile"
    assert {qos["reliability"] for qos in offered.values()} == {"reliable"}


def test_the_same_messages_give_the_same_bytes(path: Path, tmp_path: Path) -> None:
    (tmp_path / "again").mkdir()
    assert write_recording(tmp_path / "again" / "recovery.mcap", MESSAGES).read_bytes() == path.read_bytes()


def test_a_recording_that_fails_midway_leaves_the_old_file_and_nothing_else(path: Path) -> None:
    before = path.read_bytes()

    def failing() -> Iterator[Any]:
        yield MESSAGES[0]
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_recording(path, failing())
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing/recovery.mcap: cannot be written"):
        write_recording(tmp_path / "missing" / "recovery.mcap", MESSAGES)


def test_fields_left_out_are_empty_and_rotations_the_identity() -> None:
    marker = to_message("visualization_msgs/msg/Marker", {"id": np.int64(3)})
    assert (marker.id, marker.ns, marker.points) == (3, "", [])
    assert (marker.pose.orientation.w, marker.pose.orientation.x) == (1.0, 0.0)
    info = to_message("sensor_msgs/msg/CameraInfo", {})
    assert info.k.shape == (9,)


@pytest.mark.parametrize(("kind", "fields"), [("std_msgs/msg/UInt32", {"dat": 1}), ("std_msgs/msg/Nothing", {})])
def test_a_misspelt_field_or_type_is_an_error(kind: str, fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"has no field|unknown message type"):
        to_message(kind, fields)


def test_with_its_outline_the_folder_is_a_rosbag2_recording_of_version_9(tmp_path: Path) -> None:
    write_recording(tmp_path / "recovery.mcap", MESSAGES, outline=True)
    assert {path.name for path in tmp_path.iterdir()} == {"recovery.mcap", "metadata.yaml"}
    info = yaml.safe_load((tmp_path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (info["version"], info["storage_identifier"], info["relative_file_paths"]) == (9, "mcap", ["recovery.mcap"])
    told = {topic["topic_metadata"]["name"]: topic for topic in info["topics_with_message_count"]}
    assert told["/fit/net_force"]["message_count"] == 2
    assert [told[topic]["topic_metadata"]["offered_qos_profiles"][0]["durability"] for topic in ("/fit/material", "/fit/net_force")] == ["transient_local", "volatile"]
    with Reader(tmp_path) as reader:
        assert [(connection.topic, stamp) for connection, stamp, _ in reader.messages()] == [(m[0], m[2]) for m in MESSAGES]
