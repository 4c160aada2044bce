"""A managed node (lifecycle) that manages itself unless it is told not to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from .net import Net, foreseen

UNCONFIGURED = "unconfigured"
KEPT, CONFIGURED, ACTIVE = range(3)  # what an entity lasts for


class ManagedNode(LifecycleNode):
    """Configure, activate, deactivate and clean up by the services of ROS 2's managed nodes, or by `start_itself`.

    What is made in `configure` lasts until clean-up, what is made in `activate` until deactivation: subscriptions, services, timers. A
    transition that meets bad input says so in one sentence and fails; the node stays in the state before.
    """

    def __init__(self, name: str, net: Net) -> None:
        self.net = net
        self._made: list[tuple[int, Callable[[Any], Any], Any]] = []  # of which level, how it is destroyed, what
        self._level = KEPT
        self._why: Exception | None = None
        self._by_itself = False
        super().__init__(name, automatically_declare_parameters_from_overrides=True)

    @property
    def lifecycle(self) -> str:
        """unconfigured, inactive, active or finalized."""
        return str(self._state_machine.current_state[1])

    @property
    def active(self) -> bool:
        """Whether the node listens and works."""
        return self._level == ACTIVE

    def configure(self) -> None:
        """Make services, check what was given. Raises InputError."""

    def activate(self) -> None:
        """Make subscriptions, begin to work. Raises InputError."""

    def on_configured(self) -> None:
        """Before `configure`."""

    def on_activated(self) -> None:
        """After `activate`."""

    def on_deactivated(self) -> None:
        """After what `activate` made is gone."""

    def on_cleaned(self) -> None:
        """After what `configure` made is gone."""

    def own_entities(self) -> None:
        """What was made until now stays whatever the state."""
        self._level = CONFIGURED

    def start_itself(self) -> None:
        """Configure and activate. Raises what either raises."""
        self._by_itself = True
        try:
            for trigger in (self.trigger_configure, self.trigger_activate):
                if trigger() != TransitionCallbackReturn.SUCCESS and self._why is not None:
                    raise self._why
        finally:
            self._by_itself = False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._through(self.on_configured, self.configure, undo=self._clean)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._level = ACTIVE
        return self._through(self.activate, self.on_activated, undo=self._rest)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._through(self._rest, self.on_deactivated)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._through(self._clean)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        return self._through(self._rest, self.on_deactivated, self._clean)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        why = self._why
        outcome = self._through(self._rest, self._clean)
        self._why = why or self._why  # start_itself raises what went wrong first
        return outcome

    def create_subscription(self, *arguments: Any, **options: Any) -> Any:
        """As rclpy's, gone with the state in which it was made."""
        return self._noted(super().create_subscription(*arguments, **options), self.destroy_subscription)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any) -> Any:
        """As rclpy's, under the net, gone with the state in which it was made."""
        return self._noted(super().create_service(srv_type, srv_name, self.net.answering(callback, srv_name), **options), self.destroy_service)

    def create_timer(self, timer_period_sec: float, callback: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """As rclpy's, under the net, gone with the state in which it was made; by the steady clock, for simulated time may stand still."""
        options.setdefault("clock", Clock(clock_type=ClockType.STEADY_TIME))
        place = getattr(callback, "__name__", "timer").strip("_")
        return self._noted(super().create_timer(timer_period_sec, self.net.around(callback, place), *arguments, **options), self.destroy_timer)

    def destroy_timer(self, timer: Any) -> bool:
        """As rclpy's."""
        self._made = [entry for entry in self._made if entry[2] is not timer]
        return bool(super().destroy_timer(timer))

    def destroy_node(self) -> None:
        """As rclpy's, which forgets the state machine: it would keep the node, and with it the middleware's shared memory, beyond the process."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def _noted(self, made: Any, destroy: Callable[[Any], Any]) -> Any:
        self._made.append((self._level, destroy, made))
        return made

    def _destroy(self, level: int) -> None:
        for own, destroy, made in list(self._made):
            if own >= level:
                destroy(made)
        self._made = [entry for entry in self._made if entry[0] < level]

    def _rest(self) -> None:
        self._destroy(ACTIVE)
        self._level = CONFIGURED

    def _clean(self) -> None:
        self._destroy(CONFIGURED)
        self.on_cleaned()

    def _through(self, *steps: Callable[[], None], undo: Callable[[], None] | None = None) -> TransitionCallbackReturn:
        self._why = None
        try:
            for step in steps:
                step()
        except Exception as error:
            self._why = error
            if undo is not None:
                undo()
            if not self._by_itself:
                self.net.catch(error, "lifecycle")
            return TransitionCallbackReturn.FAILURE if foreseen(error) else TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS
