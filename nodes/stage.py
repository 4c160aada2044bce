"""What the five nodes share: parameters, a worker, publishers from the topic table, diagnostics at 1 Hz."""

from __future__ import annotations

import functools
import platform
import re
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_policy_name_from_kind

from diffphys_ros.msg_schemas import TOPICS, messages

from .convert import message_class, to_ros
from .managed import ManagedNode
from .memory import give_back, held_mib, resident_mib_of
from .net import Net, foreseen, sentence_of
from .parameters import AUTOSTART, Own, Parameters
from .qos import OVERRIDES, check_override, is_stream, overridable, profile
from .streams import Doubt, Stream, silences
from .worker import CANCELLED, DONE, FAILED, NEWS, Event, Worker

POLL_S = 0.05
DIAGNOSTICS_S = 1.0
SILENCE_WARNING_S = 1.0  # looked at once a second: said within two
SAID_AGAIN_S = 10.0  # a word that still holds
IDLE_AGAIN_S = 60.0  # that nothing has come yet, where nothing need come: a graph may wait for hours to be used
KEPT_MIB = 32.0  # by which a node may grow with a job before it gives memory back
JOIN_S = 2.0  # how long a closing node waits for its worker
UNHEARD = "unheard"  # kind of a doubt
HEALTH, CLOCK = "/diagnostics", "/clock"
_NAME = re.compile(r"[~/\w][\w/]*")


class StageNode(ManagedNode):
    """A node that does one long job in a worker thread; callbacks only store and enqueue, and none of them can end the node.

    Subclasses override `configure` (services, what is checked), `activate` (subscriptions, a first job), on_news, on_done, on_failed,
    waiting_for and health. Their attributes stand before this constructor, which configures and activates the node (parameter autostart).
    """

    sparse: tuple[str, ...] = ()  # topics of a driver on which a message now and then will do

    def __init__(self, name: str, own: Sequence[Own] = (), publishes: Sequence[str] = ()) -> None:
        self.streams: dict[str, Stream] = {}  # by resolved topic
        self._inputs: dict[str, str] = {}  # resolved topics by the names that the node gives them, and by themselves
        self._overridable: set[str] = set()  # beginnings of parameters qos_overrides.*
        super().__init__(name, Net(self.get_logger))
        overrides: Mapping[str, Any] = self.get_parameters_by_prefix("")
        for override in (each for each in overrides if each.startswith(OVERRIDES)):
            check_override(override, overrides[override].value)
        self.parameters = Parameters(self, own, reader=name, changed=self._changed)
        self.worker = Worker()
        self.state = "waiting"
        self.exit_status: int | None = None  # with which the process shall end now
        self.received = 0
        self.last_input: float | None = None
        self._publishes, self._outputs = publishes, dict[str, Publisher]()
        self._said: dict[object, float] = {}  # until when a word is not said again
        self._peak_mib, self._lean_mib = 0.0, resident_mib_of("self")
        self.advertise(HEALTH)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(POLL_S, self._poll, clock=steady)
        self.create_timer(DIAGNOSTICS_S, self._diagnose, clock=steady)
        self._quiet_since = time.monotonic()
        self.own_entities()
        if self.parameters[AUTOSTART.name]:
            self.start_itself()

    def create_subscription(self, msg_type: Any, topic: str, callback: Callable[..., Any], qos_profile: Any, *arguments: Any, **options: Any) -> Any:
        """As rclpy's, under the net, with a profile that parameters may override and, where a driver keeps sending, an eye on what is lost."""
        resolved = self.resolve_topic_name(topic)
        if resolved == CLOCK:  # rclpy's own
            return LifecycleNode.create_subscription(self, msg_type, topic, callback, qos_profile, *arguments, **options)
        self._inputs |= {topic: resolved, resolved: resolved}
        self._overridable.add(f"{OVERRIDES}{resolved}.subscription")
        qos = copy(qos_profile) if isinstance(qos_profile, QoSProfile) else QoSProfile(depth=qos_profile)
        stream = Stream(resolved, sparse=topic in self.sparse) if is_stream(qos) else None
        events = {} if stream is None else {"event_callbacks": _events(stream)}
        caught = self.net.around(callback if stream is None else _heard_by(stream, callback), resolved)
        options |= {"qos_overriding_options": overridable()}
        try:
            made = super().create_subscription(msg_type, topic, caught, qos, *arguments, **events, **options)
        except UnsupportedEventTypeError:  # another middleware does not tell
            made = super().create_subscription(msg_type, topic, caught, qos, *arguments, **options)
        if stream is not None:
            self.streams[resolved], stream.reliable = stream, qos.reliability == ReliabilityPolicy.RELIABLE
        return made

    def close(self) -> None:
        """Stop the work; called once before the node is destroyed."""
        self.worker.cancel(JOIN_S)

    def on_deactivated(self) -> None:
        """What runs ends; what was received, and what is latched, stays."""
        self.worker.cancel(JOIN_S)
        self._poll()
        self.streams.clear()
        self._inputs.clear()

    def on_cleaned(self) -> None:
        """Nothing is latched any more."""
        for name in [name for name in self._outputs if name != HEALTH]:
            self.destroy_publisher(self._outputs.pop(name))
        self.state = "waiting"

    def on_configured(self) -> None:
        """Publishers for what the node gives."""
        self.advertise(*self._publishes)

    def on_activated(self) -> None:
        """A word for every override that found no topic."""
        for name in self._parameters:
            if name.startswith(OVERRIDES) and name.rpartition(".")[0] not in self._overridable:
                topics = ", ".join(sorted(each.removeprefix(OVERRIDES) for each in self._overridable))
                self.get_logger().warning(f"parameter {name} changes nothing: the node has no such topic; it has {topics}")

    def advertise(self, *names: str) -> None:
        """Publishers for names of the topic table; one that exists is replaced, so that its latched history is gone."""
        for name in names:
            if name in self._outputs:
                self.destroy_publisher(self._outputs.pop(name))
            topic = TOPICS[name]
            self._overridable.add(f"{OVERRIDES}{self.resolve_topic_name(name)}.publisher")
            self._outputs[name] = self.create_publisher(message_class(topic.type_name), name, profile(topic), qos_overriding_options=overridable())

    def send(self, name: str, fields: Mapping[str, Any] | Any) -> None:
        """Publish a plain message, or one that is converted already, on a topic of the table."""
        ready = to_ros(TOPICS[name].type_name, fields) if isinstance(fields, Mapping) else fields
        if name in self._outputs:  # else the node was cleaned up meanwhile
            self._outputs[name].publish(ready)

    def acknowledged(self, *names: str, within: Duration) -> None:
        """Wait until those who subscribe have received what was published on these topics."""
        for name in names:
            self._outputs[name].wait_for_all_acked(within)

    def heard(self, name: str) -> bool:
        """Whether anybody subscribes to a topic of the table."""
        return name in self._outputs and bool(self._outputs[name].get_subscription_count())

    def now_ns(self) -> int:
        """The node's clock [ns]."""
        return self.get_clock().now().nanoseconds

    def note_input(self) -> None:
        """Count a received message, for diagnostics."""
        self.received += 1
        self.last_input = self._quiet_since = time.monotonic()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """As rclpy's; the answer says from when on the change holds."""
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            result.reason = self.parameters.holds
        return result

    def on_parameters(self, names: Collection[str]) -> Collection[str]:
        """Some of the node's parameters have changed; returns those that hold at once."""
        return ()

    def on_news(self, news: Any) -> None:
        """The worker yielded something."""

    def on_done(self, result: Any) -> None:
        """The worker returned."""

    def on_failed(self, reason: str) -> None:
        """The worker stopped for a reason, one sentence: state says whether it failed or was cancelled."""
        if self.state == FAILED:
            self.get_logger().error(reason)
        else:  # a line of its own: rclpy refuses two severities from one line
            self.get_logger().info(reason)

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

    def _changed(self, names: Collection[str]) -> str:
        later = sorted(set(names) - set(self.on_parameters(names)))
        if not later:
            return ""
        words = f"{', '.join(later)}: holds for the next job" + ("; one is running with the value before" if self.worker.busy else "")
        self.get_logger().info(words)
        return words

    def _poll(self) -> None:
        for event in self.worker.poll():
            self._handle(event)

    def _handle(self, event: Event) -> None:
        if event.kind == NEWS:
            self.on_news(event.value)
            return
        if event.kind == DONE:
            self.state = "done"
            try:
                self.on_done(event.value)
            except Exception as error:  # a result that cannot be published is none
                self.state = FAILED
                self.on_failed(self.net.catch(error, "result"))
        else:
            self.state = event.kind
            self.on_failed(self._reason(event))
        self.on_idle()
        del event
        if resident_mib_of("self") > self._lean_mib + KEPT_MIB:
            give_back()
        self._lean_mib = resident_mib_of("self")

    def _reason(self, event: Event) -> str:
        if event.kind == CANCELLED:
            return "cancelled; ~/fit begins again"
        return sentence_of(event.value) if foreseen(event.value) else self.net.catch(event.value, self.task)

    def _diagnose(self) -> None:
        now, wanted = time.monotonic(), self.waiting_for() if self.active else ""
        doubts = [*self._doubts(now), *self._unheard(now, wanted)]
        for doubt in doubts:
            self._warn(doubt, now)
        failed = self.state == FAILED or self.net.faults
        level = messages.ERROR if failed else messages.WARN if (doubts and self.watchful) or self.net.bad_input_lately or self.doubtful() else messages.OK
        present = held_mib()
        self._peak_mib = max(self._peak_mib, present)
        values = {
            "state": self.state,
            "lifecycle": self.lifecycle,
            "waiting_for": wanted,
            "received": self.received,
            "lost": sum(stream.lost for stream in self.streams.values()),
            "input_age_s": None if self.last_input is None else now - self.last_input,
            "refused": self.net.refused,
            "faults": self.net.faults,
            "last_error": self.net.last_fault or self.net.last,
            **self.health(),
            "memory_mib": present,
            "peak_memory_mib": self._peak_mib,
        }
        said = "; ".join([self.state, *(doubt.text for doubt in doubts)])
        status = messages.status(f"{self.get_name()}: {self.task}", values, level=level, message=said, hardware_id=platform.node())
        self.send(HEALTH, messages.diagnostics(self.now_ns(), [status]))

    @property
    def watchful(self) -> bool:
        """Whether silence is worth a warning: a driver should be sending, or a part of the input is there."""
        return bool(self.streams) or self.received > 0

    def _doubts(self, now: float) -> Iterator[Doubt]:
        publishers = {topic: self.count_publishers(topic) for topic in self.streams}
        for topic, stream in self.streams.items():
            stream.mismatch = stream.mismatch if publishers[topic] else ""
            yield from stream.doubts(now)
        yield from silences(self.streams.values(), publishers, now)

    def _unheard(self, now: float, wanted: str) -> Iterator[Doubt]:
        if wanted and now - self._quiet_since > SILENCE_WARNING_S:
            yield Doubt(UNHEARD, wanted, f"no data for {now - self._quiet_since:.0f} s; waiting for {_NAME.sub(self._resolved, wanted)}")

    def _resolved(self, name: re.Match[str]) -> str:
        topic = self._inputs.get(name[0])
        if topic is None:
            return name[0]
        count = self.count_publishers(topic)
        return topic + (f" ({count} publisher{'s' * (count > 1)})" if count else " (no publisher)")

    def _warn(self, doubt: Doubt, now: float) -> None:
        self._said = {said: until for said, until in self._said.items() if now < until}
        if doubt[:2] in self._said:
            return
        idle = doubt.kind == UNHEARD and not self.watchful
        self._said[doubt[:2]] = now + (IDLE_AGAIN_S if idle else SAID_AGAIN_S)
        if idle:
            self.get_logger().info(doubt.text)
        else:
            self.get_logger().warning(doubt.text)

    @property
    def task(self) -> str:
        """What the node does, for the name of its diagnostics."""
        return self.get_name().removesuffix("_node")


def _heard_by(stream: Stream, callback: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(callback)
    def heard(message: Any, *about: Any) -> Any:
        stream.hear(message)
        return callback(message, *about)

    return heard


def _events(stream: Stream) -> SubscriptionEventCallbacks:
    def mismatched(event: Any) -> None:
        stream.mismatch = qos_policy_name_from_kind(event.last_policy_kind).lower()

    def lost(event: Any) -> None:
        stream.lose(event.total_count_change)

    return SubscriptionEventCallbacks(message_lost=lost, incompatible_qos=mismatched)
