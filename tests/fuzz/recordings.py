"""Hostile recordings through the reader: spoiled files, foreign types, promises that are not kept, paths that are none."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType
from rosbags.rosbag2 import StoragePlugin

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip
from tests.fuzz._recorded import (
    COLOUR_TOPIC,
    COMPRESSED,
    DEPTH_TOPIC,
    HEIGHT,
    IMAGE,
    INFO,
    INFO_TOPIC,
    MASK_TOPIC,
    START_NS,
    TF,
    TF_TOPIC,
    WIDTH,
    Message,
    base,
    chunked,
    files,
    header_of,
    mcap_of,
    raw_of,
    rosbag,
    spoil,
)

COUNT = 25_000
FOREIGN = ("std_msgs/msg/String", "std_msgs/msg/Empty", "sensor_msgs/msg/Imu", "geometry_msgs/msg/TransformStamped", "no_msgs/msg/Nothing", "", INFO, IMAGE, TF)
NUMBERS = (0, 1, -1, 2, 7, 255, 2**15, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1, 10**18)
FLOATS = (0.0, -0.0, 1.0, -1.0, 7.0, 1e-300, 1e300, 1e38, -1e38, 5e-324, np.nan, np.inf, -np.inf, 0.5, 200.0)
TEXTS = ("", "rgb8", "bgr8", "mono8", "16UC1", "32FC1", "nv21", "jpeg", "png", "16UC1; compressedDepth png", "\0", "\n\n", "é" * 50, "x" * 5000, "/", "a b", "none")


def case(seed: int, folder: Path) -> str:
    """One hostile recording, read with settings that may not fit it."""
    rng = np.random.default_rng(seed)
    kinds: list[Callable[[np.random.Generator, Path], Path | str]] = [_spoiled, _spoiled, _messages, _messages, _messages, _folder, _chunks, _path]
    path = kinds[int(rng.integers(len(kinds)))](rng, folder)
    try:
        clip = read_clip(path, _settings(rng))
    except InputError as error:
        return refused(error)
    check(clip)
    return "taken"


def refused(error: InputError) -> str:
    """That a refusal is one short printable line."""
    text = str(error)
    assert text, "an empty sentence"
    assert "\n" not in text, f"several lines: {text!r}"
    assert len(text) < 600, f"{len(text)} characters: {text[:200]!r}"
    assert text.isprintable(), f"unprintable: {text!r}"
    return "refused"


def check(clip: Clip) -> None:
    """That a clip is whole."""
    count, height, width, channels = clip.frames.shape
    assert count >= 2
    assert (clip.frames.dtype, channels) == (np.uint8, 3)
    assert (height, width) == (clip.camera.height, clip.camera.width)
    assert np.isfinite(clip.period_s)
    assert clip.period_s > 0
    assert np.isfinite(clip.camera.pixel_from_camera).all()
    assert np.isfinite(clip.camera.world_from_camera).all()
    assert clip.seen.shape == (count,)
    if clip.depth is not None:
        assert clip.depth.shape == (count, height, width)
        assert np.isfinite(clip.depth).all()
        assert (clip.depth >= 0).all()
    if clip.first_labels is not None:
        assert clip.first_labels.ndim == 2
    assert all("\n" not in note and len(note) < 600 for note in clip.notes)


def _settings(rng: np.random.Generator) -> config.Settings:
    values: dict[str, Any] = {"topics.mask": MASK_TOPIC} if rng.random() < 0.9 else {"topics.image": COLOUR_TOPIC}
    for name in ("image", "depth", "camera_info", "mask"):
        if rng.random() < 0.08:
            values[f"topics.{name}"] = str(rng.choice([COLOUR_TOPIC, DEPTH_TOPIC, INFO_TOPIC, MASK_TOPIC, TF_TOPIC, "/none", "none", "x" * 3000, "\n"]))
    if rng.random() < 0.2:
        values["camera.fov_deg"] = float(rng.choice([1.0, 60.0, 170.0]))
    if rng.random() < 0.3:
        values["camera.fps"] = float(rng.choice([0.1, 30.0, 2000.0]))
    return config.build(values)


# -- what is done to it


def _written(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _spoiled(rng: np.random.Generator, folder: Path) -> Path:
    suffix, data = files()[int(rng.integers(len(files())))]
    return _written(folder, f"clip{suffix}", spoil(rng, data))


def _folder(rng: np.random.Generator, folder: Path) -> Path:
    bag = folder / "bag"
    bag.mkdir()
    for name, data in rosbag(StoragePlugin.MCAP if rng.random() < 0.5 else StoragePlugin.SQLITE3):
        how = rng.random()
        if name == "metadata.yaml" and how < 0.8:
            data = spoil(rng, data) if how < 0.3 else _metadata(rng, data)
        elif how > 0.85:
            data = spoil(rng, data)
        (bag / name).write_bytes(data)
    if rng.random() < 0.05:
        os.mkfifo(bag / "pipe.mcap")
    return bag


def _metadata(rng: np.random.Generator, data: bytes) -> bytes:
    text = data.decode()
    words = ["version: 9", "storage_identifier: mcap", "storage_identifier: sqlite3", "message_count: 8", "bag.mcap", "bag.db3", "type: " + IMAGE, "compression_mode: ''"]
    word = str(rng.choice([w for w in words if w in text] or ["version: 9"]))
    key = word.split(":")[0] + ":" if ":" in word else ""
    bomb = "[" + ", ".join(["*a"] * 9) + "]"
    values = ["-1", "10", "null", "[]", "{}", "x" * 3000, "&a [1]", "*a", "[" * 2000, "../../etc/passwd", "'\\0'", "1e400", "9" * 5000, ".nan", "2020-13-45", "!!python/name:os.system"]
    spoiled = text.replace(word, f"{key} {rng.choice(values)}", 1)
    how = rng.random()
    if how < 0.15:
        lines = ["a: &a [1]"] + [f"b{k}: &a {bomb}" for k in range(9)] + ["storage_identifier: *a"]
        return "\n".join(["rosbag2_bagfile_information:"] + ["  " + line for line in lines]).encode()
    if how < 0.3:
        return str(rng.choice(["", "[]", "1", "rosbag2_bagfile_information: 3", "rosbag2_bagfile_information: []", "\0", "{" * 3000, "- " * 3000])).encode()
    if how < 0.45:
        return text.replace("compression_mode: ''", f"compression_mode: {rng.choice(['file', 'message', 'FILE', 'x'])}").replace("compression_format: ''", "compression_format: zstd").encode()
    return spoiled.encode()


def _messages(rng: np.random.Generator, folder: Path) -> Path:
    found = [_changed(rng, message) if rng.random() < 0.05 else message for message in map(_copied, base())]
    kept = [raw for message in found if rng.random() > 0.01 and (raw := _serialised(rng, message)) is not None]
    if rng.random() < 0.2:
        kept = [kept[i] for i in rng.permutation(len(kept))]
    compression = list(CompressionType)[int(rng.integers(len(CompressionType)))]
    data = mcap_of(kept, compression=compression, chunk_size=int(rng.choice([100, 4000, 10**6])), use_chunking=bool(rng.random() < 0.8))
    return _written(folder, "clip.mcap", data)


def _copied(message: Message) -> Message:
    topic, kind, ns, fields = message
    return topic, kind, ns, {**fields, "header": {**fields["header"], "stamp": dict(fields["header"]["stamp"])}} if "header" in fields else dict(fields)


def _serialised(rng: np.random.Generator, message: Message) -> tuple[str, str, int, bytes] | None:
    topic, kind, ns, fields = message
    try:
        raw = raw_of(kind, fields)
    except Exception:  # the writer refuses what no publisher could send
        return None
    if rng.random() < 0.01:
        raw = spoil(rng, raw)
    if rng.random() < 0.004:
        kind = str(rng.choice(FOREIGN))
    return topic, kind, ns, raw


def _changed(rng: np.random.Generator, message: Message) -> Message:
    topic, kind, ns, fields = message
    how = int(rng.integers(6))
    if how == 0:
        topic = str(rng.choice([COLOUR_TOPIC, DEPTH_TOPIC, INFO_TOPIC, MASK_TOPIC, TF_TOPIC, "/a\nb", "/" + "x" * 3000, ""]))
    elif how == 1:
        ns = int(rng.choice([0, 1, START_NS, START_NS + 10**18, 2**63 - 1])) if rng.random() < 0.8 else 2**64 - 1
    elif "header" in fields and how == 2:
        fields["header"]["stamp"] = {"sec": int(rng.choice([0, 1, -1, 2**31 - 1, -(2**31), 1_700_000_000])), "nanosec": int(rng.choice([0, 1, 999_999_999, 2**32 - 1]))}
    elif kind == TF:
        fields = {"transforms": _links(rng)}
    elif kind == INFO:
        fields = fields | _info(rng)
    elif rng.random() < 0.15:
        return topic, COMPRESSED, ns, {"header": fields["header"], "format": str(rng.choice(TEXTS)), "data": _picture(rng)}
    else:
        fields = fields | _odd_image(rng, fields)
    return topic, kind, ns, fields


def _odd_image(rng: np.random.Generator, fields: dict[str, Any]) -> dict[str, Any]:
    how = int(rng.integers(5))
    if how == 0:
        return {"encoding": str(rng.choice(TEXTS))}
    if how == 1:
        return {str(rng.choice(["height", "width", "step"])): int(rng.choice([0, 1, 15, 17, 2**16, 2**31, 2**32 - 1]))}
    if how == 2:
        return {"data": fields["data"][: int(rng.integers(len(fields["data"])))]}
    if how == 3:
        value = float(rng.choice(FLOATS))
        with np.errstate(over="ignore"):
            data = np.full((HEIGHT, WIDTH), value, np.float32)
        return {"encoding": "32FC1", "step": 4 * WIDTH, "data": data.tobytes()}
    size = int(rng.choice([1, 2, 3, 40]))
    data = np.zeros((size, size, 3), np.uint8)
    return {"encoding": "rgb8", "height": size, "width": size, "step": 3 * size, "data": data.tobytes()}


def _info(rng: np.random.Generator) -> dict[str, Any]:
    k = np.array([30.0, 0, 11.5, 0, 30, 7.5, 0, 0, 1])
    for _ in range(int(rng.integers(0, 3))):
        k[int(rng.integers(9))] = float(rng.choice(FLOATS))
    d = rng.choice(FLOATS, int(rng.integers(0, 15))) if rng.random() < 0.5 else rng.normal(0, 0.2, int(rng.integers(0, 15)))
    model = str(rng.choice(["plumb_bob", "rational_polynomial", "equidistant", "", "fisheye", "x" * 3000]))
    return {"k": k, "d": d, "distortion_model": model, "width": int(rng.choice([0, 1, WIDTH, 2**32 - 1], p=[0.1, 0.1, 0.7, 0.1]))}


def _links(rng: np.random.Generator) -> list[dict[str, Any]]:
    names = ["optical", "map", "a", "b", "", "x" * 3000, "\n"]
    links = []
    for _ in range(int(rng.integers(0, 6))):
        rotation = dict(zip("xyzw", rng.choice([0.0, 1.0, np.nan, 1e300, 1e-300, 0.5], 4, p=[0.4, 0.3, 0.05, 0.05, 0.05, 0.15]), strict=True))
        translation = dict(zip("xyz", rng.choice(FLOATS, 3) if rng.random() < 0.4 else rng.normal(0, 1, 3), strict=True))
        header = header_of(START_NS, str(rng.choice(names)))
        links.append({"header": header, "child_frame_id": str(rng.choice(names)), "transform": {"translation": translation, "rotation": rotation}})
    return links


@lru_cache
def _png() -> bytes:
    return bytes(cv2.imencode(".png", np.arange(HEIGHT * WIDTH * 3, dtype=np.uint8).reshape(HEIGHT, WIDTH, 3))[1])


@lru_cache
def _jpeg() -> bytes:
    return bytes(cv2.imencode(".jpg", np.arange(HEIGHT * WIDTH * 3, dtype=np.uint8).reshape(HEIGHT, WIDTH, 3))[1])


def _picture(rng: np.random.Generator) -> bytes:
    how = int(rng.integers(5))
    data = _png() if rng.random() < 0.5 else _jpeg()
    return [data, spoil(rng, data), b"", rng.bytes(200), data[: int(rng.integers(len(data)))]][how]


def _chunks(rng: np.random.Generator, folder: Path) -> Path:
    """Chunks that say one thing and hold another."""
    from backports import zstd

    size = int(rng.choice([0, 10, 10**5, 10**7]))
    packed = zstd.compress(bytes(size))
    if rng.random() < 0.2:
        packed = spoil(rng, packed)
    stated = int(rng.choice([size, size, 0, 100, 2**31, 2**40, 2**63 - 1]))
    data = chunked(packed, stated, indexed=bool(rng.random() < 0.7), entries=int(rng.choice([1, 1, 2, 500])))
    return _written(folder, "clip.mcap", data)


def _path(rng: np.random.Generator, folder: Path) -> Path | str:
    """What is no recording at all."""
    how = int(rng.integers(12))
    if how == 0:
        os.mkfifo(folder / "clip.mcap")
        return folder / "clip.mcap"
    if how == 1:
        return str(rng.choice(["x" * 5000, "/" * 3000, "\ud800", "a\ud800b.mp4", "é\n.mcap", "a" * 300 + ".mcap", "", "~", "/dev/null", "/dev/zero", ".", "http://localhost:9/x.mp4"])) if rng.random() < 0.8 else "a\0b"
    if how == 2:
        return folder
    if how == 3:
        (folder / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
        return folder
    if how == 4:
        name = str(rng.choice(["clip.mcap", "clip.db3", "clip.mp4", "clip.avi", "clip.bag", "clip.png", "clip", "é\n.mp4"]))
        playlist = b"#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n/dev/zero\n"
        content = [b"", rng.bytes(2000), playlist, b"ffconcat version 1.0\nfile /dev/zero\n", b"SQLite format 3\0" + rng.bytes(500), b"RIFF" + rng.bytes(300)]
        return _written(folder, name, content[int(rng.integers(len(content)))])
    if how == 5:
        os.symlink("loop.mcap", folder / "loop.mcap")
        return folder / "loop.mcap"
    if how == 6:
        (folder / "clip.mcap").mkdir()
        return folder / "clip.mcap"
    if how == 7:
        return _written(folder, "clip.avi", spoil(rng, _video()))
    if how == 8:
        return _written(folder, "clip.db3", _trap(rng, folder))
    return _pictures(rng, folder)


@lru_cache
def _video() -> bytes:
    import tempfile

    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "clip.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (WIDTH, HEIGHT))
        for k in range(4):
            writer.write(np.full((HEIGHT, WIDTH, 3), 40 * k, np.uint8))
        writer.release()
        return path.read_bytes()


def _trap(rng: np.random.Generator, folder: Path) -> bytes:
    """A database whose tables do not end, or hold what they should not."""
    import sqlite3

    endless = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT"
    views = [f"CREATE VIEW message_definitions AS {endless} x AS topic_type, x AS encoding, x AS encoded_message_definition, x AS type_description_hash FROM c"]
    views += [f"CREATE VIEW schema AS {endless} 4 AS schema_version FROM c", "CREATE VIEW schema AS SELECT zeroblob(900000000) AS schema_version"]
    views += ["CREATE TABLE schema(schema_version TEXT)", "INSERT INTO topics VALUES(1, NULL, 5, 'cdr', '', '')", "DROP TABLE topics"]
    path = folder / "making.db3"
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format, offered_qos_profiles, type_description_hash)")
    base.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
    base.execute(views[int(rng.integers(len(views)))])
    base.execute("INSERT INTO messages VALUES(1, 1, ?, ?)", [(5, b"x"), ("now", "text"), (2**62, None), (1.5, 2)][int(rng.integers(4))])
    base.commit()
    base.close()
    data = path.read_bytes()
    path.unlink()
    return data


def _pictures(rng: np.random.Generator, folder: Path) -> Path:
    """A folder of pictures, some broken."""
    place = folder / str(rng.choice(["images", "bilder é", "a.mcap", "x" * 200]))
    place.mkdir()
    for k in range(int(rng.integers(1, 6))):
        how = rng.random()
        name = str(rng.choice([f"f{k}.png", f"ü{k}.PNG", f"f{'9' * 200}{k}.png", f"\n{k}.jpg", f"f{k}.jpeg"]))
        if how < 0.1:
            (place / name).mkdir(exist_ok=True)
        elif how < 0.15 and not (place / name).exists():
            os.mkfifo(place / name)
        elif not (place / name).is_dir() and not (place / name).is_fifo():
            (place / name).write_bytes(_png() if how < 0.7 else _picture(rng))
    return place
