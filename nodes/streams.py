"""What a driver's topics bring: loss on the way, low rate and silence, each with its cure."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from .middleware import PROFILE, VARIABLE
from .qos import OVERRIDES

WINDOW_S = 3.0  # what is looked at
SILENT_S = 1.0  # /diagnostics look once a second: said within two
LEAST_HZ = 5.0  # below it the motion between two frames is too large to be followed
LEAST_SHARE = 0.8  # of the messages that the stamps make expected
FEW = 5  # messages, of which a rate says nothing


class Doubt(NamedTuple):
    """Something wrong with a topic."""

    kind: str  # lost, slow, silent, incompatible
    topic: str  # resolved
    text: str  # one sentence, with the cure


class Stream:
    """One topic that a driver keeps sending on; `topic` is its resolved name, and `sparse` means that a message now and then will do."""

    def __init__(self, topic: str, *, sparse: bool = False) -> None:
        self.topic, self.sparse, self.reliable = topic, sparse, False
        self.received = self.lost = 0
        self.last: float | None = None
        self.mismatch = ""  # the policy that a publisher does not offer
        self._heard: deque[tuple[float, int]] = deque(maxlen=4000)  # when, and the stamp [ns]
        self._losses: deque[tuple[float, int]] = deque(maxlen=4000)

    def hear(self, message: Any, now: float | None = None) -> None:
        """A message came."""
        self.last = time.monotonic() if now is None else now
        self.received += 1
        stamp = message.header.stamp
        self._heard.append((self.last, stamp.sec * 10**9 + stamp.nanosec))

    def lose(self, count: int, now: float | None = None) -> None:
        """The middleware says that it could not deliver so many."""
        self.lost += count
        self._losses.append((time.monotonic() if now is None else now, count))

    def doubts(self, now: float) -> Iterator[Doubt]:
        """What is wrong with what came within WINDOW_S."""
        for kept in (self._heard, self._losses):
            while kept and now - kept[0][0] > WINDOW_S:
                kept.popleft()
        lost, came = sum(count for _, count in self._losses), len(self._heard)
        if self.mismatch:
            yield Doubt("incompatible", self.topic, f"{self.topic}: a publisher offers another {self.mismatch} than is wanted, nothing comes from it; {self._other_quality()}")
        if lost:
            yield Doubt("lost", self.topic, f"{self.topic}: {lost} of {lost + came} messages of the last {WINDOW_S:g} s were lost on the way; {self._more_room()}")
        elif not self.sparse and (words := self._slow()):
            yield Doubt("slow", self.topic, f"{self.topic}: {words}; {self._more_room()}")

    def silent(self, now: float) -> bool:
        """Whether nothing comes; a slow topic is given three of its own periods."""
        if self.last is None:
            return True
        periods = np.diff([when for when, _ in self._heard])
        return now - self.last > max(SILENT_S, 3 * float(np.median(periods)) if len(periods) else 0.0)

    def _slow(self) -> str:
        if len(self._heard) < FEW:
            return ""
        stamps = np.sort(np.array([stamp for _, stamp in self._heard])) * 1e-9
        steps = np.diff(stamps)
        steps = steps[steps > 0]
        if len(steps) < FEW - 1:
            return ""
        span, period = float(steps.sum()), float(np.median(steps))
        rate, expected = len(steps) / span, span / period
        if len(steps) < LEAST_SHARE * expected:
            return f"{len(steps)} of about {expected:.0f} messages come, by their stamps ({rate:.1f} in place of {1 / period:.1f} Hz)"
        return f"comes at {rate:.1f} Hz, at least {LEAST_HZ:g} Hz are needed" if rate < LEAST_HZ else ""

    def _more_room(self) -> str:
        if self.reliable:
            return "publisher, network or this machine is too slow: send smaller images, or fewer"
        return f"start the driver with {VARIABLE}={PROFILE}, or set reliability:=reliable ({OVERRIDES}{self.topic}.subscription.reliability)"

    def _other_quality(self) -> str:
        return f"set reliability:=best_effort ({OVERRIDES}{self.topic}.subscription.reliability), or have the publisher offer it"


def silences(streams: Iterable[Stream], publishers: dict[str, int], now: float) -> Iterator[Doubt]:
    """Topics that somebody publishes and that are silent while another of these brings messages."""
    streams = list(streams)
    if all(stream.silent(now) for stream in streams):
        return
    for stream in streams:
        if not stream.sparse and stream.silent(now) and publishers.get(stream.topic, 0):
            since = "yet" if stream.last is None else f"for {now - stream.last:.0f} s"
            yield Doubt("silent", stream.topic, f"{stream.topic}: no message {since}, though it has a publisher; {stream._more_room()}")
