"""What the five nodes share: parameters, a worker, publishers from the topic table, diagnostics at 1 Hz."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher

from diffphys_ros.msg_schemas import TOPICS, messages

from .convert import message_class, to_ros
from .net import Net, foreseen, sentence_of
from .parameters import Own, Parameters
from .qos import profile
from .worker import CANCELLED, DONE, FAILED, NEWS, Event, Worker

POLL_S = 0.05
DIAGNOSTICS_S = 1.0
SILENCE_WARNING_S = 5.0
JOIN_S = 1.0  # how long a closing node waits for its worker
HEALTH = "/diagnostics"


class StageNode(Node):
    """A node that does one long job in a worker thread; callbacks only store and enqueue, and none of them can end the node.

    Subclasses override on_news, on_done, on_failed, waiting_for and health.
    """

    def __init__(self, name: str, own: Sequence[Own] = (), publishes: Sequence[str] = ()) -> None:
        self.net = Net(self.get_logger)
        super().__init__(name, automatically_declare_parameters_from_overrides=True)
        self.parameters = Parameters(self, own, reader=name)
        self.worker = Worker()
        self.state = "waiting"
        self.received = 0
        self.last_input: float | None = None
        self._outputs: dict[str, Publisher] = {}
        self.advertise(HEALTH, *publishes)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(POLL_S, self._poll, clock=steady)
        self.create_timer(DIAGNOSTICS_S, self._diagnose, clock=steady)
        self._quiet_since = time.monotonic()

    def create_subscription(self, msg_type: Any, topic: str, callback: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """As rclpy's, under the net."""
        return super().create_subscription(msg_type, topic, self.net.around(callback, topic), *arguments, **options)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any) -> Any:
        """As rclpy's, under the net."""
        return super().create_service(srv_type, srv_name, self.net.answering(callback, srv_name), **options)

    def create_timer(self, timer_period_sec: float, callback: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """As rclpy's, under the net."""
        return super().create_timer(timer_period_sec, self.net.around(callback, getattr(callback, "__name__", "timer").strip("_")), *arguments, **options)

    def close(self) -> None:
        """Stop the work; called once before the node is destroyed."""
        self.worker.cancel(JOIN_S)

    def advertise(self, *names: str) -> None:
        """Publishers for names of the topic table; one that exists is replaced, so that its latched history is gone."""
        for name in names:
            if name in self._outputs:
                self.destroy_publisher(self._outputs.pop(name))
            topic = TOPICS[name]
            self._outputs[name] = self.create_publisher(message_class(topic.type_name), name, profile(topic))

    def send(self, name: str, fields: Mapping[str, Any] | Any) -> None:
        """Publish a plain message, or one that is converted already, on a topic of the table."""
        ready = to_ros(TOPICS[name].type_name, fields) if isinstance(fields, Mapping) else fields
        self._outputs[name].publish(ready)

    def now_ns(self) -> int:
        """The node's clock [ns]."""
        return self.get_clock().now().nanoseconds

    def note_input(self) -> None:
        """Count a received message, for diagnostics."""
        self.received += 1
        self.last_input = self._quiet_since = time.monotonic()

    def on_news(self, news: Any) -> None:
        """The worker yielded something."""

    def on_done(self, result: Any) -> None:
        """The worker returned."""

    def on_failed(self, reason: str) -> None:
        """The worker stopped for a reason, one sentence."""

    def on_idle(self) -> None:
        """The worker ended, for whatever reason, and the node has answered to that."""

    def waiting_for(self) -> str:
        """The topic that is waited for; empty where nothing is."""
        return ""

    def health(self) -> Mapping[str, Any]:
        """More keys for /diagnostics."""
        return {}

    def doubtful(self) -> bool:
        """Whether /diagnostics warns though no input was refused."""
        return False

    def _poll(self) -> None:
        for event in self.worker.poll():
            self._handle(event)

    def _handle(self, event: Event) -> None:
        if event.kind == NEWS:
            self.on_news(event.value)
        elif event.kind == DONE:
            self.state = "done"
            try:
                self.on_done(event.value)
            except Exception as error:  # a result that cannot be published is none
                self.state = FAILED
                self.on_failed(self.net.catch(error, "result"))
        else:
            self.state = event.kind
            self.on_failed(self._reason(event))
        if event.kind != NEWS:
            self.on_idle()

    def _reason(self, event: Event) -> str:
        if event.kind == CANCELLED:
            return "cancelled; ~/fit begins again"
        return sentence_of(event.value) if foreseen(event.value) else self.net.catch(event.value, self.task)

    def _diagnose(self) -> None:
        wanted = self.waiting_for()
        if wanted and time.monotonic() - self._quiet_since > SILENCE_WARNING_S:
            self._quiet_since = time.monotonic()
            self.get_logger().warning(f"no data for {SILENCE_WARNING_S:g} s; waiting for {wanted}")
        level = messages.ERROR if self.state == FAILED or self.net.faults else messages.WARN if self.net.bad_input_lately or self.doubtful() else messages.OK
        age = None if self.last_input is None else time.monotonic() - self.last_input
        values = {
            "state": self.state,
            "waiting_for": wanted,
            "received": self.received,
            "input_age_s": age,
            "refused": self.net.refused,
            "faults": self.net.faults,
            "last_error": self.net.last_fault or self.net.last,
            **self.health(),
            "memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        }
        status = messages.status(f"{self.get_name()}: {self.task}", values, level=level, message=self.state, hardware_id="host")
        self.send(HEALTH, messages.diagnostics(self.now_ns(), [status]))

    @property
    def task(self) -> str:
        """What the node does, for the name of its diagnostics."""
        return self.get_name().removesuffix("_node")
