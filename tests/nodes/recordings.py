"""Recordings as a camera driver and rosbag2 make them, for the tests of the nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from diffphys_ros.bags.storage import typestore
from diffphys_ros.bags.write import to_message
from diffphys_ros.msg_schemas import messages
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, IMAGE, TREE

COLOUR, INFO, NOTE = "/camera/color/image_rect", "/camera/color/camera_info", "/notes"
STRING = "std_msgs/msg/String"
NEVER = QosTime(9223372036, 854775807)
WAYS = {
    "mcap": (StoragePlugin.MCAP, CompressionMode.NONE),
    "mcap, zstd chunks": (StoragePlugin.MCAP, CompressionMode.STORAGE),
    "sqlite3": (StoragePlugin.SQLITE3, CompressionMode.NONE),
    "sqlite3, zstd messages": (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    "sqlite3, zstd file": (StoragePlugin.SQLITE3, CompressionMode.FILE),
}


def offered(reliable: bool, latched: bool, depth: int) -> list[Qos]:
    reliability = QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return [Qos(QosHistory.KEEP_LAST, depth, reliability, durability, NEVER, NEVER, QosLiveliness.AUTOMATIC, NEVER, False)]


OFFERED = {COLOUR: offered(False, False, 5), INFO: offered(True, False, 5), NOTE: offered(True, True, 1), "/tf_static": offered(True, True, 1)}


def recorded(path: Path, clip: Any, way: str = "mcap", *, bad: int = -1) -> Path:
    """A rosbag2 folder of a clip's images as a camera driver gives them: best effort, with a latched note and a static tree first.

    Image number `bad` is shorter than it says, and a message that is none comes after it.
    """
    plugin, mode = WAYS[way]
    writer, store = Writer(path, version=9, storage_plugin=plugin), typestore()
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        lines: dict[str, Any] = {}

        def write(topic: str, kind: str, ns: int, fields: dict[str, Any]) -> None:
            if topic not in lines:
                lines[topic] = writer.add_connection(topic, kind, typestore=store, offered_qos_profiles=OFFERED.get(topic, ()))
            writer.write(lines[topic], ns, store.serialize_cdr(to_message(kind, fields), kind))

        write("/tf_static", TREE, clip.start_ns, messages.static_tree(clip.start_ns, clip.camera))
        write(NOTE, STRING, clip.start_ns, {"data": "latched"})
        for k, seconds in enumerate(clip.times):
            ns = clip.start_ns + round(seconds * 1e9)
            head = messages.header(ns, clip.camera.frame_id)
            write(INFO, CAMERA_INFO, ns, messages.camera_info(head, clip.camera))
            picture = messages.image(head, clip.frames[k], "rgb8")
            write(COLOUR, IMAGE, ns, picture | ({"data": picture["data"][:100]} if k == bad else {}))
            if k == bad:
                writer.write(lines[COLOUR], ns + 1, bytes(7))
    return path
