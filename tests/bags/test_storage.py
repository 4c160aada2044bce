"""Recordings that promise, hide or hold what they should not: each is read without it or refused in one sentence."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.storage import existing, typestore
from diffphys_ros.bags.write import to_message
from diffphys_ros.errors import InputError

from .conftest import START_NS, Message, colour_topic, info_topic

DEFAULT = config.Settings()
Record = Callable[..., Path]


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Writes messages into a rosbag2 folder and returns its path."""

    def write(*topics: Iterator[Message], plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
        with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
            connections: dict[tuple[str, str], Any] = {}
            for topic, kind, ns, fields, _ in (message for some in topics for message in some):
                if (topic, kind) not in connections:
                    connections[topic, kind] = writer.add_connection(topic, kind, typestore=typestore())
                writer.write(connections[topic, kind], ns, typestore().serialize_cdr(to_message(kind, fields), kind))
        return tmp_path / "bag"

    return write


def announce(bag: Path, topic: str, kind: str) -> Path:
    """Makes the folder's metadata announce five messages of a topic that its file does not hold."""
    metadata = bag / "metadata.yaml"
    entry = f"""  - message_count: 5
    topic_metadata:
      name: {topic}
      type: {kind}
      serialization_format: cdr
      offered_qos_profiles: []
      type_description_hash: ''
"""
    key = "topics_with_message_count:\n"
    text = metadata.read_text()
    assert key in text
    metadata.write_text(text.replace(key, key + entry))
    return bag


@pytest.mark.parametrize(("topic", "kind"), [("/d/image", "sensor_msgs/msg/Image"), ("/x/camera_info", "sensor_msgs/msg/CameraInfo")])
def test_a_topic_that_is_announced_but_empty_is_taken_as_not_there(folder: Callable[..., Path], topic: str, kind: str) -> None:
    clip = read_clip(announce(folder(colour_topic(), info_topic()), topic, kind), DEFAULT)
    assert len(clip) == 6
    assert clip.depth is None


def test_an_empty_topic_that_is_named_is_refused(folder: Callable[..., Path]) -> None:
    bag = announce(folder(colour_topic(), info_topic()), "/d/image", "sensor_msgs/msg/Image")
    with pytest.raises(InputError, match=r"topics\.depth is '/d/image', must be one of /camera/image_raw"):
        read_clip(bag, config.build({"topics.depth": "/d/image"}))


def test_a_topic_of_two_types_is_refused_with_both(folder: Callable[..., Path]) -> None:
    odd = [("/camera/image_raw", "std_msgs/msg/String", START_NS, {"data": "x"}, False)]
    with pytest.raises(InputError, match=r"/camera/image_raw holds messages of 2 types \(sensor_msgs/msg/Image, std_msgs/msg/String\), must hold one"):
        read_clip(folder(colour_topic(), info_topic(), iter(odd)), DEFAULT)


def test_another_topic_of_two_types_does_not_matter(folder: Callable[..., Path]) -> None:
    odd = [("/chatter", f"std_msgs/msg/{kind}", START_NS, {}, False) for kind in ("String", "Empty")]
    assert len(read_clip(folder(colour_topic(), info_topic(), iter(odd)), DEFAULT)) == 6


def test_transforms_of_another_type_are_refused(record: Record) -> None:
    odd = [("/tf_static", "std_msgs/msg/String", START_NS, {"data": "x"}, True)]
    with pytest.raises(InputError, match=r"topic /tf_static holds std_msgs/msg/String, must hold tf2_msgs/msg/TFMessage"):
        read_clip(record(colour_topic(), info_topic(), iter(odd)), DEFAULT)


def test_a_mask_topic_without_images_is_refused_with_those_that_have(record: Record) -> None:
    with pytest.raises(InputError, match=r"topics\.mask is '/camera/camera_info', must be one of /camera/image_raw"):
        read_clip(record(colour_topic(), info_topic()), config.build({"topics.mask": "/camera/camera_info"}))


def test_a_topics_name_is_shortened_and_kept_on_one_line(record: Record) -> None:
    with pytest.raises(InputError) as caught:
        read_clip(record(*(colour_topic(f"/{'x' * 3000}\n{k}") for k in range(40)), info_topic()), DEFAULT)
    assert len(str(caught.value)) < 600
    assert str(caught.value).isprintable()


# -- paths


@pytest.mark.parametrize("path", ["x" * 5000, "a\0b", "\ud800", "/" + "a/" * 3000, "nothing.mcap", "line\nbreak.mp4"])
def test_a_path_that_cannot_be_is_refused_in_one_short_line(path: str) -> None:
    with pytest.raises(InputError, match="there is no such file or folder") as caught:
        read_clip(path, DEFAULT)
    assert len(str(caught.value)) < 300
    assert str(caught.value).isprintable()


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", ["clip.mcap", "clip.db3", "clip.mp4", "clip"])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(InputError, match="is neither a regular file nor a folder"):
        read_clip(tmp_path / name, DEFAULT)
    with pytest.raises(InputError, match="is neither a regular file nor a folder"):
        existing("/dev/zero")


@pytest.mark.timeout(20)
def test_a_pipe_in_a_recordings_folder_is_refused(folder: Callable[..., Path]) -> None:
    bag = folder(colour_topic(), info_topic())
    (bag / "bag.mcap").unlink()
    os.mkfifo(bag / "bag.mcap")
    with pytest.raises(InputError, match=r"bag\.mcap is no regular file"):
        read_clip(bag, DEFAULT)


# -- what unpacks to more than it is

LIMITED = """
import resource, sys
from pathlib import Path
from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.storage import typestore
from diffphys_ros.errors import InputError
import rosbags.rosbag2
typestore()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
try:
    read_clip(sys.argv[1], config.Settings())
except InputError as error:
    print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
BOMB = 1 << 31  # bytes that unpack from some 200 kB


def refused_and_peak(path: Path) -> tuple[str, float]:
    """The sentence with which another process refuses a recording, and how much its memory grew over it [MB]."""
    done = subprocess.run([sys.executable, "-c", LIMITED, str(path)], capture_output=True, text=True, timeout=60, check=True)
    *sentence, kilobytes = done.stdout.strip().splitlines()
    assert len(sentence) == 1, done.stdout
    return sentence[0], float(kilobytes) / 1e3


@pytest.fixture(scope="module")
def bomb() -> bytes:
    """A zstd frame of many zeros."""
    from backports import zstd

    machine = zstd.ZstdCompressor(level=1)
    return b"".join([*(machine.compress(bytes(1 << 24)) for _ in range(BOMB >> 24)), machine.flush()])


@pytest.mark.parametrize("stated", [BOMB, 1000])
@pytest.mark.parametrize("indexed", [True, False])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused_before_it_is(tmp_path: Path, bomb: bytes, stated: int, indexed: bool) -> None:
    from tests.fuzz._recorded import chunked

    path = tmp_path / "clip.mcap"
    path.write_bytes(chunked(bomb, stated, indexed=indexed, entries=1))
    assert path.stat().st_size < 1e6
    sentence, grown = refused_and_peak(path)
    assert re.search(r"open at once|more than the 1000 bytes", sentence)
    assert grown < 100


def test_a_chunk_that_the_index_names_often_is_refused(tmp_path: Path) -> None:
    from backports import zstd

    from tests.fuzz._recorded import chunked

    path = tmp_path / "clip.mcap"
    path.write_bytes(chunked(zstd.compress(bytes(1000)), 1000, indexed=True, entries=500))
    with pytest.raises(InputError, match="its index names chunks that overlap"):
        read_clip(path, DEFAULT)


@pytest.mark.parametrize("mode", ["file", "message"])
def test_a_folder_that_unpacks_to_gigabytes_is_refused(folder: Callable[..., Path], bomb: bytes, mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diffphys_ros.bags.unpacked.FREE_BYTES", 1 << 28)
    bag = folder(colour_topic(), info_topic(), plugin=StoragePlugin.SQLITE3)
    metadata = bag / "metadata.yaml"
    text = re.sub(r"compression_mode: .*", f"compression_mode: {mode}", metadata.read_text())
    text = re.sub(r"compression_format: .*", "compression_format: zstd", text)
    if mode == "file":
        (bag / "bag.db3.zstd").write_bytes(bomb)
        text = text.replace("- bag.db3\n", "- bag.db3.zstd\n")
    else:
        import sqlite3

        with sqlite3.connect(bag / "bag.db3") as base:
            base.execute("UPDATE messages SET data = ?", [bomb])
    metadata.write_text(text)
    with pytest.raises(InputError, match=r"unpack to more than|unpacks to more than"):
        read_clip(bag, DEFAULT)


def test_metadata_with_aliases_is_refused(folder: Callable[..., Path]) -> None:
    bag = folder(colour_topic(), info_topic())
    metadata = bag / "metadata.yaml"
    lines = ["  a0: &a0 [x, x]", *(f"  a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10))]
    text = re.sub(r"storage_identifier: .*", "storage_identifier: *a9", metadata.read_text())
    metadata.write_text(text.replace("rosbag2_bagfile_information:\n", "\n".join(["rosbag2_bagfile_information:", *lines, ""])))
    with pytest.raises(InputError, match=r"metadata\.yaml holds aliases"):
        read_clip(bag, DEFAULT)


@pytest.mark.timeout(30)
def test_a_database_whose_tables_do_not_end_is_refused(tmp_path: Path) -> None:
    import sqlite3

    with sqlite3.connect(tmp_path / "clip.db3") as base:
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles, type_description_hash)")
        base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        base.execute("CREATE TABLE schema(schema_version)")
        base.execute("INSERT INTO schema VALUES(4)")
        endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS topic_type, x AS encoding"
        base.execute(f"CREATE VIEW message_definitions AS {endless}, x AS encoded_message_definition, x AS type_description_hash, x AS id FROM c")
    with pytest.raises(InputError, match="not a complete ROS 2 recording"):
        read_clip(tmp_path / "clip.db3", DEFAULT)
