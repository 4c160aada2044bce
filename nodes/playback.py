"""Plays a recovery at the rate at which it was recorded."""

from __future__ import annotations

from rclpy.clock import Clock, ClockType

from diffphys_ros.config import Playback as PlaybackSettings
from diffphys_ros.msg_schemas.fields import Answer
from diffphys_ros.msg_schemas.recording import played
from diffphys_ros.msg_schemas.topics import relative

from .stage import StageNode


class Playback:
    """Publishes ~/state, ~/force_markers, ~/net_force and ~/rendered frame by frame; stamps are those of the recording."""

    def __init__(self, node: StageNode, answer: Answer, settings: PlaybackSettings) -> None:
        self.answer, self.frame = answer, 0
        self._node, self._loop = node, settings.loop
        self._timer = node.create_timer(answer.period_s / settings.rate, self._next, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def stop(self) -> None:
        """Play no more."""
        self._timer.cancel()
        self._node.destroy_timer(self._timer)

    def _next(self) -> None:
        for message in played(self.answer, self.frame):
            self._node.send(relative(message.topic), message.fields)
        self.frame += 1
        if self.frame == len(self.answer):
            self.frame = 0
            if not self._loop:
                self._timer.cancel()
