"""QoS profiles of the topic table, and what a user may override of them."""

from __future__ import annotations

from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from diffphys_ros.errors import InputError, short
from diffphys_ros.msg_schemas.topics import KEEP_ALL, Topic

RELIABILITY = {"best_effort": ReliabilityPolicy.BEST_EFFORT, "reliable": ReliabilityPolicy.RELIABLE}
OVERRIDES = "qos_overrides."  # prefix of the parameters
POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
_VALUES: dict[str, tuple[str, ...]] = {
    "history": ("keep_last", "keep_all"),
    "depth": (),
    "reliability": ("reliable", "best_effort"),
    "durability": ("transient_local", "volatile"),
}
SENSOR_DEPTH = 10
RELIABLE_DEPTH = 90  # three seconds at 30 Hz: a camera that does not stop must not fill the memory of a node that is too slow
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


def is_stream(qos: QoSProfile) -> bool:
    """Whether a profile is one of `sensor`: of a topic that a driver keeps sending on."""
    return qos.durability != DurabilityPolicy.TRANSIENT_LOCAL and (qos.reliability == ReliabilityPolicy.BEST_EFFORT or qos.depth == RELIABLE_DEPTH)


def overridable() -> QoSOverridingOptions:
    """Parameters qos_overrides./TOPIC.(publisher|subscription).(history|depth|reliability|durability)."""
    return QoSOverridingOptions(POLICIES)


def check_override(name: str, value: Any) -> None:
    """Raises InputError for a parameter qos_overrides.* that names no policy, or a value that it does not have."""
    policy = name.rpartition(".")[2]
    if policy not in _VALUES:
        raise InputError(f"parameter {name}: must end with .{', .'.join(_VALUES)}; name one of these policies")
    known = _VALUES[policy]
    good = value in known if known else isinstance(value, int) and not isinstance(value, bool) and value >= 0
    if not good:
        raise InputError(f"parameter {name} is {short(value)}, must be {' or '.join(known) or 'a whole number'}; leave it out to keep the default")
