"""A recording that is played, heard by ingest_node as if a camera sent it: by the names that camera_topics has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from diffphys_ros.bags.storage import open_bag, read_message
from diffphys_ros.bags.topics import COMPRESSED, choose_imu, choose_topics, depth_info, image_topics
from diffphys_ros.bags.transforms import MOVING, STATIC
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError, listed, short, shown
from diffphys_ros.msg_schemas.topics import STATIC_TREE, TREE

from .beside import COLOUR_INFO, DEPTH_INFO, IMU
from .camera_topics import IMAGE, MASK, PRESSED, Take
from .convert import message_class
from .intake import DEPTH, PRESSED_DEPTH
from .player import Part, Player
from .stage import StageNode


def play(node: StageNode, path: Path, part: Part, names: Mapping[str, str], take: Take, ended: Callable[[bool], None]) -> Player:
    """What plays a recording when it is started; `take` gets what a camera sent of it, by the `names` of `inputs`. Its static transforms hold from
    the beginning, whenever they were sent. Raises InputError as Player."""
    for tree in static_trees(path):
        take(STATIC, tree)

    def hear(topic: str, kind: str, raw: bytes) -> None:
        if topic in names:
            take(names[topic], _message(topic, kind, raw))

    return Player(node, path, part, hear=node.net.around(hear, "bag"), ended=ended)


def inputs(path: Path, topics: Topics) -> dict[str, str]:
    """Which topics of a recording are a camera's, or beside it: {as recorded: as ingest_node has it}, those that bags.read takes; static transforms
    come from `static_trees`. Raises InputError as bags.topics.choose_topics, and for a mask or an IMU that is not there."""
    with open_bag(path) as bag:
        image, depth, info = choose_topics(bag, topics, shown(path))
        if topics.mask is not None and topics.mask not in image_topics(bag):
            raise InputError(f"{shown(path)}: topics.mask is {short(topics.mask)}, must be one of {listed(sorted(image_topics(bag)), 4)}")
        found = {image: PRESSED if bag.types[image] == COMPRESSED else IMAGE, info: COLOUR_INFO, topics.mask: MASK}
        found |= {depth: PRESSED_DEPTH if depth and bag.types[depth] == COMPRESSED else DEPTH, depth_info(bag, depth, image): DEPTH_INFO}
        found |= {choose_imu(bag, topics, shown(path)): IMU, MOVING if bag.types.get(MOVING) == TREE else None: MOVING}
    return {topic: name for topic, name in found.items() if topic}


def static_trees(path: Path) -> list[Any]:
    """The static transforms of a recording, tf2_msgs/TFMessage."""
    with open_bag(path) as bag:
        return [tree for _, _, tree in bag.messages([STATIC_TREE])]


def _message(topic: str, kind: str, raw: bytes) -> Any:
    try:
        return read_message(kind, raw) if kind == TREE else deserialize_message(raw, message_class(kind))  # tf2_msgs is in no wheel
    except Exception as error:
        raise InputError(f"topic {topic}: a message that cannot be read; record it again") from error
