"""QoS profiles of the topic table."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from diffphys_ros.msg_schemas.topics import KEEP_ALL, Topic

RELIABILITY = {"best_effort": ReliabilityPolicy.BEST_EFFORT, "reliable": ReliabilityPolicy.RELIABLE}
SENSOR_DEPTH = 10
RELIABLE_DEPTH = 100  # three seconds at 30 Hz: a camera that does not stop must not fill the memory of a node that is too slow
TREE_DEPTH = 20  # links of the camera's transform tree
MOVING_DEPTH = 100  # messages of /tf, as tf2_ros has it


def profile(topic: Topic) -> QoSProfile:
    """Reliable; transient local where the table says latched; a history of one or all."""
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
        history=HistoryPolicy.KEEP_ALL if topic.depth == KEEP_ALL else HistoryPolicy.KEEP_LAST,
        depth=topic.depth,
    )


def sensor(reliability: str) -> QoSProfile:
    """Raw inputs: best effort takes every publisher; reliable needs a reliable publisher, and loses nothing of a node that keeps up."""
    if reliability == "reliable":
        return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, history=HistoryPolicy.KEEP_LAST, depth=RELIABLE_DEPTH)
    return QoSProfile(reliability=RELIABILITY[reliability], history=HistoryPolicy.KEEP_LAST, depth=SENSOR_DEPTH)


def latched() -> QoSProfile:
    """Transforms, one message per link, that late subscribers get."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL, depth=TREE_DEPTH)


def moving() -> QoSProfile:
    """Transforms that are sent again and again: /tf as tf2_ros publishes it, reliable and volatile."""
    return QoSProfile(reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE, depth=MOVING_DEPTH)
