"""Plays a recording into ROS as it was recorded: topics, qualities of service, pace, and the clock. For where `ros2 bag` is not installed.

The recording is read as it is played, so it may be larger than the memory.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage

from diffphys_ros.bags.offers import Offer
from diffphys_ros.bags.read import is_bag, window
from diffphys_ros.bags.storage import open_bag
from diffphys_ros.errors import InputError, listed, shown
from diffphys_ros.msg_schemas import messages

from .convert import message_class, to_ros

CLOCK, CLOCK_S = "/clock", 0.01
BURST_S = 0.02  # other callbacks of the node wait no longer
SHORTEST_S, LONGEST_S = 1e-4, 0.1  # between two looks at what is due
Raw = tuple[str, int, bytes]  # topic, log time [ns], CDR


class Part(NamedTuple):
    """What is played of a recording, and how fast."""

    rate: float = 1.0  # relative to the recording
    loop: bool = False
    start_s: float = 0.0  # left out at the beginning
    duration_s: float = 0.0  # of the recording; 0: to its end


class Player:
    """Publishes a recording from timers of `node`. `hear` gets (topic, type, CDR) of everything that is played, and raises nothing; `ended` is called at the end
    of every pass with whether another follows. Topics are called as recorded, or as `names` says; without `names` all are played. At least `kept` messages
    of a topic wait for a reliable subscriber that is late, whatever depth was recorded.

    Raises InputError for what is no recording, or is damaged; what is noticed while it plays ends the play under the node's net.
    """

    def __init__(
        self,
        node: Node,
        path: Path,
        part: Part,
        *,
        names: Mapping[str, str] | None = None,
        kept: int = 0,
        hear: Callable[[str, str, bytes], None] = lambda topic, kind, raw: None,
        ended: Callable[[bool], None] = lambda again: None,
    ) -> None:
        if not is_bag(path):
            raise InputError(f"{shown(path)}: is no recording, which alone can be played; give an MCAP file, a .db3 file or a rosbag2 folder, or rate 0")
        self._node, self._path, self._part, self._kept, self._hear, self._ended = node, path, part, kept, hear, ended
        self._open = ExitStack()
        self._bag = self._open.enter_context(open_bag(path))
        self.begin_ns, self.end_ns = window(self._bag, part.start_s, part.duration_s or None, shown(path))
        self.kinds = {topic: kind for topic, kind in self._bag.types.items() if names is None or topic in names}
        self.outputs: dict[str, Any] = {}
        self.unknown = self._advertise(names or {})
        self._clock = node.create_publisher(ClockMessage, CLOCK, QoSProfile(depth=1))
        self._timers: list[Any] = []
        self._began, self.over = 0.0, False  # over: nothing more is played
        self._left: Iterator[Raw] = iter(())
        self._next: Raw | None = None

    def start(self) -> None:
        """Begin to play."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._begin()
        self._timers = [self._node.create_timer(period, what, clock=steady) for period, what in ((SHORTEST_S, self._play), (CLOCK_S, self._tell_time))]

    def stop(self) -> None:
        """Play no more; publishers stay, so that what is latched can be had."""
        self.over = True
        for timer in self._timers:  # a node that was deactivated has destroyed them already
            self._node.destroy_timer(timer)
        self._timers = []
        self._open.close()

    def close(self) -> None:
        """Stop, and nothing that was latched can be had any more."""
        self.stop()
        for output in (*self.outputs.values(), self._clock):
            self._node.destroy_publisher(output)
        self.outputs = {}

    @property
    def now_ns(self) -> int:
        """Time of the recording that is played [ns]."""
        played_s = (time.monotonic() - self._began) * self._part.rate
        return min(self.begin_ns + round(played_s * 1e9), self.end_ns)

    def _advertise(self, names: Mapping[str, str]) -> dict[str, str]:
        """Publishers; returns the topics, with their types, that cannot be published because the package of the type is not installed."""
        unknown = dict.fromkeys(self._bag.mixed, "several types")
        for topic, kind in self.kinds.items():
            try:
                self.outputs[topic] = self._node.create_publisher(message_class(kind), names.get(topic, topic), _profile(self._bag.offer(topic), self._kept))
            except (ImportError, AttributeError, ValueError, TypeError, NameValidationException):  # a recording may name anything
                unknown[topic] = kind
        if unknown:
            said = listed([f"{topic} ({kind})" for topic, kind in unknown.items()], 4)
            self._node.get_logger().warning(f"not played, because the packages of their types are not installed here, they have several types, or their names are none of ROS: {said}")
        return unknown

    def _begin(self) -> None:
        self._began, latched = time.monotonic(), [topic for topic in self.kinds if self._bag.offer(topic).latched]
        for message in self._bag.raw(latched, None, self.begin_ns):  # who hears the part needs what was latched before it
            self._send(message)
        self._left = self._bag.raw(list(self.kinds), self.begin_ns, self.end_ns)
        self._next = next(self._left, None)

    def _play(self) -> None:
        looked = time.monotonic()
        while self._next is not None and self._next[1] <= self.now_ns and time.monotonic() - looked < BURST_S:
            self._send(self._next)
            self._advance()
        if self._next is None and self.now_ns >= self.end_ns:
            self._end()
        else:
            due_s = SHORTEST_S if self._next is None else (self._next[1] - self.now_ns) * 1e-9 / self._part.rate
            self._timers[0].timer_period_ns = round(min(max(due_s, SHORTEST_S), LONGEST_S) * 1e9)
            self._timers[0].reset()

    def _advance(self) -> None:
        try:
            self._next = next(self._left, None)
        except InputError:  # the recording is damaged from here on
            self.stop()
            self._ended(False)
            raise

    def _end(self) -> None:
        if self._part.loop:
            self._open.close()
            self._bag = self._open.enter_context(open_bag(self._path))  # the bounds on what one opening may unpack hold for a pass
            self._ended(True)
            self._begin()
        else:
            self.stop()
            self._tell_time()
            self._ended(False)

    def _send(self, message: Raw) -> None:
        topic, _, raw = message
        if topic in self.outputs:
            self.outputs[topic].publish(raw)
        self._hear(topic, self.kinds[topic], raw)

    def _tell_time(self) -> None:
        self._clock.publish(to_ros("rosgraph_msgs/msg/Clock", {"clock": messages.stamp(self.now_ns)}))


def _profile(offer: Offer, kept: int) -> QoSProfile:
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE if offer.reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if offer.latched else DurabilityPolicy.VOLATILE,
        history=HistoryPolicy.KEEP_LAST if offer.depth else HistoryPolicy.KEEP_ALL,
        depth=max(offer.depth, kept) if offer.depth and not offer.latched else offer.depth,
    )
