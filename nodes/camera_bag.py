"""A recording that is played, heard by ingest_node as if a camera sent it: by the names that camera_topics has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.serialization import deserialize_message

from diffphys_ros.bags.storage import open_bag
from diffphys_ros.bags.topics import COMPRESSED, choose_topics, image_topics
from diffphys_ros.bags.transforms import STATIC
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError, listed, short, shown
from diffphys_ros.msg_schemas.topics import STATIC_TREE

from .beside import COLOUR_INFO
from .camera_topics import IMAGE, MASK, PRESSED, Take
from .convert import message_class
from .intake import DEPTH
from .player import Part, Player
from .stage import StageNode


def play(node: StageNode, path: Path, part: Part, topics: Topics, take: Take, ended: Callable[[bool], None]) -> Player:
    """What plays a recording when it is started; `take` gets what a camera sent of it. Raises InputError as Player and `inputs`."""
    names = inputs(path, topics)
    for tree in static_trees(path):
        take(STATIC, tree)

    def hear(topic: str, kind: str, raw: bytes) -> None:
        if topic in names:
            take(names[topic], _message(topic, kind, raw))

    return Player(node, path, part, hear=node.net.around(hear, "bag"), ended=ended)


def inputs(path: Path, topics: Topics) -> dict[str, str]:
    """Which topics of a recording are a camera's: {as recorded: as ingest_node has it}. Raises InputError as bags.topics.choose_topics,
    and for a mask that is not there."""
    with open_bag(path) as bag:
        image, depth, info = choose_topics(bag, topics, shown(path))
        if topics.mask is not None and topics.mask not in image_topics(bag):
            raise InputError(f"{shown(path)}: topics.mask is {short(topics.mask)}, must be one of {listed(sorted(image_topics(bag)), 4)}")
        found = {image: PRESSED if bag.types[image] == COMPRESSED else IMAGE, depth: DEPTH, info: COLOUR_INFO, topics.mask: MASK}
    return {topic: name for topic, name in found.items() if topic}


def static_trees(path: Path) -> list[Any]:
    """The static transforms of a recording, tf2_msgs/TFMessage."""
    with open_bag(path) as bag:
        return [tree for _, _, tree in bag.messages([STATIC_TREE])]


def _message(topic: str, kind: str, raw: bytes) -> Any:
    try:
        return deserialize_message(raw, message_class(kind))
    except Exception as error:
        raise InputError(f"topic {topic}: a message that cannot be read; record it again") from error
