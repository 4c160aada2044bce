"""Puts the world and the camera's optical frame into the tree of transforms where nobody else does, so that a viewer can show what is published."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile

from diffphys_ros.msg_schemas.fields import Answer
from diffphys_ros.msg_schemas.topics import STATIC_TREE, TREE

from .convert import message_class, to_ros
from .stage import StageNode

LISTEN_S = 2.0  # to what others say of the camera, before anything is said
TREES = {STATIC_TREE: DurabilityPolicy.TRANSIENT_LOCAL, "/tf": DurabilityPolicy.VOLATILE}
DEPTH = 100  # messages of a tree that are heard


class Tree:
    """Says on /tf_static where the camera of an answer stands. Where tf2_msgs is not installed it says nothing, as it does where somebody
    else places the camera's frame."""

    def __init__(self, node: StageNode) -> None:
        self._node, self._links = node, list[tuple[str, str]]()
        self._heard: list[Any] = []
        self._timer: Any = None
        self._output: Any = None

    def announce(self, answer: Answer) -> None:
        """Listen for LISTEN_S, then say what is missing."""
        try:
            kind = message_class(TREE)
        except ImportError:
            self._node.get_logger().info(f"tf2_msgs is not installed: nothing is said on {STATIC_TREE}; viewers need the frame {answer.world!r} from elsewhere")
            return
        self._end()
        self._links.clear()
        self._heard = [self._node.create_subscription(kind, topic, self._hear, QoSProfile(depth=DEPTH, durability=kept)) for topic, kept in TREES.items()]
        self._timer = self._node.create_timer(LISTEN_S, lambda: self._say(answer), clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _hear(self, tree: Any) -> None:
        self._links += [(link.header.frame_id, link.child_frame_id) for link in tree.transforms]

    def _say(self, answer: Answer) -> None:
        self._end()
        if self._output is None and is_missing(answer, self._links):
            self._output = self._node.create_publisher(message_class(TREE), STATIC_TREE, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
        if self._output is not None:
            self._output.publish(to_ros(TREE, answer.tree()))

    def _end(self) -> None:
        for each in self._heard:
            self._node.destroy_subscription(each)
        self._heard = []
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None


def is_missing(answer: Answer, links: Iterable[tuple[str, str]]) -> bool:
    """Whether nobody places the camera of an answer, by the (parent, child) frames of a tree. A camera without a pose is placed in a world for
    viewers alone, so only where nobody knows its frame."""
    frame = answer.camera.frame_id
    links = list(links)
    known = any(frame == child for _, child in links)
    return not known and (answer.camera.pose_known or not any(frame == parent for parent, _ in links))
