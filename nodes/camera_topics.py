"""The raw topics of a camera, live, by the names that ingest_node has for them."""

from __future__ import annotations

from collections.abc import Callable
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
Take = Callable[[str, Any], None]  # gets the name of a topic, STATIC and MOVING among them, and a message


def subscribe(node: StageNode, take: Take, reliability: str) -> None:
    """Subscribe a node to all of them; `reliability` is that of a camera's own topics."""
    for name, kind in SENSORS.items():
        node.create_subscription(kind, name, partial(take, name), sensor(reliability))
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
