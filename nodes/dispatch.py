"""Clips on their way to the other nodes: one at a time, the next one when all that listen have ended with it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from diffphys_ros.msg_schemas import messages

from .intake import Intake

MOST_WAITING = 2


class Dispatch:
    """Holds clips back while a stage is at work on the one before, at most MOST_WAITING; others are dropped and counted."""

    def __init__(self) -> None:
        self.waiting: deque[Intake] = deque()
        self.out: int | None = None  # the clip that was sent, by its first stamp [ns]
        self.dropped = 0
        self._ended: set[str] = set()  # stages that are done with it
        self._free = True  # whether the next may follow, whoever has not ended

    def add(self, clip: Intake) -> bool:
        """A clip to send; false where it is dropped."""
        if len(self.waiting) >= MOST_WAITING:
            self.dropped += 1
            return False
        self.waiting.append(clip)
        return True

    def next(self, stages: Iterable[str]) -> Intake | None:
        """The clip to send now, if any; `stages` are those that listen."""
        if not self.waiting or self.held_up_by(stages):
            return None
        self.out, self._free = None, True  # until its first message is sent nobody can be at work on it
        return self.waiting.popleft()

    def sent(self, clip: int) -> None:
        """A clip is on its way, by its first stamp [ns]."""
        self.out, self._free, self._ended = clip, False, set()

    def hear(self, stage: str, clip: int, level: int) -> None:
        """A stage says that it has ended with a clip. One that did not succeed has nothing to hand on: nobody waits any more."""
        if clip == self.out:
            self._ended.add(stage)
            self._free = self._free or level != messages.OK

    def held_up_by(self, stages: Iterable[str]) -> list[str]:
        """Stages that have not ended with the clip that was sent; none where the next may follow."""
        return [] if self._free else sorted(set(stages) - self._ended)

    def release(self) -> int:
        """Forget what was sent and what waits; how many waited."""
        count = len(self.waiting)
        self.waiting.clear()
        self.out, self._free = None, True
        return count

    @property
    def bytes(self) -> int:
        """Of the messages of clips that wait."""
        return sum(clip.bytes for clip in self.waiting)
