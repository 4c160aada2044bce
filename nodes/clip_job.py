"""The jobs of ingest_node, in the thread of its worker: a clip's messages, no faster than they are published."""

from __future__ import annotations

import threading
import time
from collections.abc import Generator

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.world import NotYetError

from .clip_out import Ready, Sent, messages_of, messages_of_clip, ready
from .clip_topics import Plain
from .intake import Intake
from .player import Part

MOST_IN_HAND = 16  # messages of a clip between the thread that decodes them and the one that publishes
LOOK_S = 0.1
News = Plain | str | None  # a message of a clip that is ready, or what it still lacks


class Hand:
    """Where messages lie between the thread that decodes them and the one that publishes; they do not pile up."""

    def __init__(self) -> None:
        self._room = threading.Semaphore(MOST_IN_HAND)

    def published(self) -> None:
        """A message has left."""
        self._room.release()

    def through(self, steps: Generator[Plain, None, Sent]) -> Generator[News, None, Sent]:
        """The messages, each when there is room for it."""
        while True:
            while not self._room.acquire(timeout=LOOK_S):
                yield None
            try:
                yield next(steps)
            except StopIteration as stop:
                self._room.release()
                return stop.value
            except BaseException:
                self._room.release()
                raise


def collected(clip: Intake, settings: config.Settings, patience_s: float, hand: Hand) -> Generator[News, None, Sent]:
    """The messages of a clip that was collected; what it lacks may still come for a while. Raises InputError."""
    made = yield from _ready(clip, settings, patience_s)
    return (yield from hand.through(messages_of(clip, settings, made)))


def read(bag: str, settings: config.Settings, part: Part, hand: Hand) -> Generator[News, None, Sent]:
    """The messages of the clip of a recording, pictures or a video. Raises InputError."""
    yield None
    clip = read_clip(bag, settings, start_s=part.start_s, duration_s=part.duration_s or None, frames=config.FrameSettings(every=settings.frames.every))
    return (yield from hand.through(messages_of_clip(clip)))


def _ready(clip: Intake, settings: config.Settings, patience_s: float) -> Generator[News, None, Ready]:
    until, said = time.monotonic() + patience_s, ""
    while True:
        yield None
        try:
            return ready(clip, settings)
        except NotYetError as error:
            if time.monotonic() >= until:
                raise
            if str(error) != said:
                yield (said := str(error))
            time.sleep(LOOK_S)
