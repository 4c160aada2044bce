"""A small valid recording in many packings, and how bytes are spoilt."""

from __future__ import annotations

import io
import struct
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter

from diffphys_ros.bags.storage import typestore
from diffphys_ros.bags.write import to_message

FRAMES, HEIGHT, WIDTH = 8, 16, 24
START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 33_333_333
IMAGE, COMPRESSED, INFO, TF = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
COLOUR_TOPIC, DEPTH_TOPIC, INFO_TOPIC, MASK_TOPIC, TF_TOPIC = "/cam/image", "/cam/depth", "/cam/camera_info", "/mask", "/tf_static"
Message = tuple[str, str, int, dict[str, Any]]  # topic, type, log time [ns], fields


def header_of(ns: int, frame: str = "optical") -> dict[str, Any]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame}


def image_of(ns: int, data: np.ndarray, encoding: str) -> dict[str, Any]:
    shape = {"height": data.shape[0], "width": data.shape[1], "step": data.nbytes // data.shape[0]}
    return {"header": header_of(ns), "encoding": encoding, "data": data.tobytes()} | shape


def valid() -> list[Message]:
    """The messages of a small recording: colour, depth, mask, camera_info and a transform."""
    rng = np.random.default_rng(0)
    info = {"header": header_of(START_NS), "height": HEIGHT, "width": WIDTH, "distortion_model": "plumb_bob", "d": np.zeros(5)}
    info["k"] = np.array([30.0, 0, 11.5, 0, 30, 7.5, 0, 0, 1])
    link = {"header": header_of(START_NS, "map"), "child_frame_id": "optical", "transform": {"translation": {"x": 0.1, "y": 0.2, "z": 1.0}}}
    found: list[Message] = [(INFO_TOPIC, INFO, START_NS, info), (TF_TOPIC, TF, START_NS, {"transforms": [link]})]
    for k in range(FRAMES):
        ns = START_NS + k * PERIOD_NS
        found.append((COLOUR_TOPIC, IMAGE, ns, image_of(ns, rng.integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8), "rgb8")))
        found.append((DEPTH_TOPIC, IMAGE, ns, image_of(ns, rng.integers(400, 600, (HEIGHT, WIDTH)).astype(np.uint16), "16UC1")))
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[4:10, 5:15] = 1
    return [*found, (MASK_TOPIC, IMAGE, START_NS, image_of(START_NS, mask, "mono8"))]


@lru_cache
def base() -> tuple[Message, ...]:
    return tuple(valid())


def raw_of(kind: str, fields: dict[str, Any]) -> bytes:
    return bytes(typestore().serialize_cdr(to_message(kind, fields), kind))


def mcap_of(messages: list[tuple[str, str, int, bytes]], **options: Any) -> bytes:
    """An MCAP file of (topic, type, log time [ns], CDR)."""
    stream, channels = io.BytesIO(), {}
    writer = Writer(stream, **options)
    writer.start("ros2", "fuzz")
    for topic, kind, ns, raw in messages:
        if (topic, kind) not in channels:
            schema = writer.register_schema(kind, "ros2msg", b"")
            channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic, kind], min(max(ns, 0), 2**64 - 1), raw, min(max(ns, 0), 2**64 - 1))
    writer.finish()
    return stream.getvalue()


@lru_cache
def cdr() -> tuple[tuple[str, str, int, bytes], ...]:
    return tuple((topic, kind, ns, raw_of(kind, fields)) for topic, kind, ns, fields in base())


@lru_cache
def files() -> tuple[tuple[str, bytes], ...]:
    """Valid files in many packings: (suffix, bytes)."""
    whole = list(cdr())
    packings = [
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4, "chunk_size": 4000},
        {"compression": CompressionType.ZSTD, "chunk_size": 4000},
        {"compression": CompressionType.NONE, "use_chunking": False},
        {"compression": CompressionType.NONE, "index_types": IndexType.NONE, "use_statistics": False, "enable_crcs": False},
        {"compression": CompressionType.NONE, "enable_crcs": False, "chunk_size": 4000},
    ]
    return (*((".mcap", mcap_of(whole, **options)) for options in packings), (".db3", database()))


@lru_cache
def database() -> bytes:
    return dict(rosbag(StoragePlugin.SQLITE3))["bag.db3"]


@lru_cache
def rosbag(plugin: StoragePlugin) -> tuple[tuple[str, bytes], ...]:
    """Files of a rosbag2 folder."""
    with tempfile.TemporaryDirectory() as place:
        with BagWriter(Path(place) / "bag", version=9, storage_plugin=plugin) as writer:
            connections: dict[str, Any] = {}
            for topic, kind, ns, raw in cdr():
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=typestore())
                writer.write(connections[topic], ns, raw)
        return tuple((file.name, file.read_bytes()) for file in sorted((Path(place) / "bag").iterdir()))


def spoil(rng: np.random.Generator, data: bytes) -> bytes:
    """Bytes flipped, cut, doubled, overwritten."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        size = max(len(raw), 1)
        at, how = int(rng.integers(size)), int(rng.integers(7))
        if not raw:
            raw += b"\0"
        if how == 0:
            raw[at] ^= 1 << int(rng.integers(8))
        elif how == 1:
            raw[at : at + 8] = rng.bytes(8)
        elif how == 2:
            del raw[at:]
        elif how == 3:
            del raw[at : at + int(rng.integers(1, 64))]
        elif how == 4:
            raw[at:at] = raw[max(at - int(rng.integers(1, 200)), 0) : at]
        elif how == 5:
            raw[at : at + 8] = struct.pack("<Q", int(rng.choice([0, 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1], p=None)))
        else:
            raw[at : at + 4] = struct.pack("<I", int(rng.choice([0, 1, 255, 2**24, 2**31, 2**32 - 1])))
    return bytes(raw)


def chunked(packed: bytes, stated: int, *, indexed: bool, entries: int) -> bytes:
    """An MCAP file of one zstd chunk that states a size [bytes], with a summary that names the chunk `entries` times, or without one."""
    chunk = struct.pack("<QQQI", START_NS, START_NS + 10**9, stated, 0) + _text("zstd") + struct.pack("<Q", len(packed)) + packed
    start = b"\x89MCAP0\r\n" + _record(1, _text("ros2") + _text(""))
    topics = _record(3, struct.pack("<H", 1) + _text(IMAGE) + _text("ros2msg") + _text(""))
    topics += _record(4, struct.pack("<HH", 1, 1) + _text(COLOUR_TOPIC) + _text("cdr") + _text("") + _text(""))
    if not indexed:
        return start + topics + _record(6, chunk) + _record(2, bytes(20)) + b"\x89MCAP0\r\n"
    body = start + _record(6, chunk)
    topics += _record(11, struct.pack("<QHIIIIQQ", 9, 1, 1, 0, 0, 1, START_NS, START_NS + 10**9) + struct.pack("<I", 10) + struct.pack("<HQ", 1, 9))
    where = struct.pack("<QQQQ", START_NS, START_NS + 10**9, len(start), 9 + len(chunk)) + struct.pack("<IHQ", 10, 1, len(body))
    index = _record(8, where + struct.pack("<Q", 31) + _text("zstd") + struct.pack("<QQ", len(packed), stated)) * entries
    return body + topics + index + _record(2, struct.pack("<QQI", len(body), 0, 0)) + b"\x89MCAP0\r\n"


def _record(code: int, data: bytes) -> bytes:
    return struct.pack("<BQ", code, len(data)) + data


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()
