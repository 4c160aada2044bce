"""Plays a recovery at the rate at which it was recorded."""

from __future__ import annotations

from rclpy.clock import Clock, ClockType

from diffphys_ros.config import Playback as PlaybackSettings
from diffphys_ros.msg_schemas.fields import Answer
from diffphys_ros.msg_schemas.recording import played
from diffphys_ros.msg_schemas.topics import PLAYED

from .stage import StageNode


class Playback:
    """Publishes the played topics frame by frame, those that somebody hears; stamps are those of the recording.

    The first frame, and the last one where it does not loop, are published in any case: they are latched for who comes later.
    """

    def __init__(self, node: StageNode, answer: Answer, settings: PlaybackSettings) -> None:
        self.answer, self.frame = answer, 0
        self._node, self._loop, self._begun = node, settings.loop, False
        self._timer = node.create_timer(answer.period_s / settings.rate, self._next, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def stop(self) -> None:
        """Play no more."""
        self._timer.cancel()
        self._node.destroy_timer(self._timer)

    def _next(self) -> None:
        ends = self.frame + 1 == len(self.answer)
        latched = not self._begun or (ends and not self._loop)
        names = PLAYED if latched else tuple(name for name in PLAYED if self._node.heard(name))
        for message in played(self.answer, self.frame, names):
            self._node.send(message.topic, message.fields)
        self.frame, self._begun = 0 if ends else self.frame + 1, True
        if ends and not self._loop:
            self._timer.cancel()
