"""Plays a recovery at the rate at which it was recorded."""

from __future__ import annotations

from typing import Any

from rclpy.clock import Clock, ClockType

from diffphys_ros.config import Playback as PlaybackSettings
from diffphys_ros.msg_schemas.fields import Answer
from diffphys_ros.msg_schemas.recording import played
from diffphys_ros.msg_schemas.topics import PLAYED, relative

from .stage import StageNode


class Playback:
    """Publishes ~/state, ~/force_markers, ~/net_force and ~/rendered frame by frame, each while somebody subscribes to it; stamps are those
    of the recording. It stands still while nobody does."""

    def __init__(self, node: StageNode, answer: Answer, settings: PlaybackSettings) -> None:
        self.answer, self.frame = answer, 0
        self._node, self._loop = node, settings.loop
        self._period_s, self._ended = answer.period_s / settings.rate, False
        self._timer: Any = None

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
        wanted = tuple(name for name in PLAYED if self._node.heard(name) or (last and not self._loop))  # what comes later still gets the last frame
        for message in played(self.answer, self.frame, wanted):
            self._node.send(relative(message.topic), message.fields)
        self.frame = 0 if last else self.frame + 1
        if last and not self._loop:
            self._ended = True
            self.pause()
