"""Plays a recovery at the rate at which it was recorded."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock, ClockType

from diffphys_ros.config import Playback as PlaybackSettings
from diffphys_ros.msg_schemas.fields import Answer
from diffphys_ros.msg_schemas.recording import played
from diffphys_ros.msg_schemas.topics import PLAYED

from .stage import StageNode


class Playback:
    """Publishes the played topics frame by frame, each while somebody subscribes to it; stamps are those of the recording. It stands still
    while nobody does. The first frame, and the last one where it does not loop, are published in any case: they are latched for who comes later."""

    def __init__(self, node: StageNode, answer: Answer, settings: PlaybackSettings) -> None:
        self.answer, self.frame = answer, 0
        self._node, self._loop = node, settings.loop
        self._period_s, self._ended = answer.period_s / settings.rate, False
        self._timer: Any = None
        self._show(PLAYED)

    @property
    def playing(self) -> bool:
        """Whether frames are published."""
        return self._timer is not None

    def look(self) -> None:
        """Go on, or stand still, as there are subscribers."""
        heard = not self._ended and any(map(self._node.heard, PLAYED))
        if heard and self._timer is None:
            self._timer = self._node.create_timer(self._period_s, self._next, clock=Clock(clock_type=ClockType.STEADY_TIME))
        elif not heard:
            self.pause()

    def pause(self) -> None:
        """Stand still until the next look."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def _next(self) -> None:
        last = self.frame == len(self.answer) - 1
        self._show(tuple(name for name in PLAYED if self._node.heard(name) or (last and not self._loop)))
        self.frame = 0 if last else self.frame + 1
        if last and not self._loop:
            self._ended = True
            self.pause()

    def _show(self, names: tuple[str, ...]) -> None:
        for message in played(self.answer, self.frame, names):
            self._node.send(message.topic, message.fields)
