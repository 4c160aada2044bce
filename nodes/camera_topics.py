"""The raw topics of a camera, live, by the names that ingest_node has for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, Imu

from diffphys_ros.bags.transforms import MOVING, STATIC

from .beside import COLOUR_INFO, DEPTH_INFO, IMU, POSE
from .intake import DEPTH, PRESSED_DEPTH
from .qos import latched, moving, sensor
from .stage import StageNode

IMAGE, PRESSED, MASK = "image", "image/compressed", "mask"
SENSORS = {
    IMAGE: Image,
    PRESSED: CompressedImage,
    DEPTH: Image,
    PRESSED_DEPTH: CompressedImage,
    MASK: Image,
    COLOUR_INFO: CameraInfo,
    DEPTH_INFO: CameraInfo,
}
NAMES = (*SENSORS, POSE, IMU)
RAW = {PRESSED: IMAGE, PRESSED_DEPTH: DEPTH}  # of which compressed ones are published below it
ANY = "any"
TRANSPORTS = {IMAGE: {"raw": IMAGE, "compressed": PRESSED}, DEPTH: {"raw": DEPTH, "compressedDepth": PRESSED_DEPTH}}  # by their names in image_transport
Take = Callable[[str, Any], None]  # gets the name of a topic, STATIC and MOVING among them, and a message


def resolved(node: StageNode) -> dict[str, str]:
    """The topics by their names here. Who renames raw images renames the compressed ones below them too, as image_transport does it."""
    names = {name: node.resolve_topic_name(name) for name in NAMES}
    for pressed, raw in RAW.items():
        if not is_renamed(node, pressed):
            names[pressed] = names[raw] + pressed.removeprefix(raw)
    return names


def is_renamed(node: StageNode, name: str) -> bool:
    """Whether a person gave a topic another name."""
    return node.resolve_topic_name(name) != node.resolve_topic_name(name, only_expand=True)


def unwanted(transports: Mapping[str, str]) -> set[str]:
    """Topics that are not to be heard: with {IMAGE: "compressed"} the raw images, with ANY none."""
    return {topic for raw, wanted in transports.items() for word, topic in TRANSPORTS[raw].items() if wanted not in (ANY, word)}


def subscribe(node: StageNode, take: Take, reliability: str, transports: Mapping[str, str]) -> None:
    """Subscribe a node to all of them but the `unwanted`; `reliability` is that of a camera's own topics."""
    names = resolved(node)
    for name, kind in SENSORS.items():
        if name not in unwanted(transports):
            topic = names[name] if name in RAW else name  # rclpy knows nothing of the rule for compressed ones
            node.create_subscription(kind, topic, partial(take, name), sensor(reliability))
    node.create_subscription(Imu, IMU, partial(take, IMU), sensor("best_effort"))
    node.create_subscription(TransformStamped, POSE, partial(take, POSE), latched())
    _subscribe_trees(node, take)


def _subscribe_trees(node: StageNode, take: Take) -> None:
    try:
        from tf2_msgs.msg import TFMessage  # type: ignore[import-not-found]
    except ImportError:
        node.get_logger().info(f"tf2_msgs is not installed: transforms come from {node.resolve_topic_name(POSE)} alone")
        return
    for topic, quality in ((STATIC, latched()), (MOVING, moving())):
        node.create_subscription(TFMessage, topic, partial(take, topic), quality)
