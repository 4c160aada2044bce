"""One thread for long work beside a spinning node."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterator
from typing import Any, NamedTuple

NEWS, DONE, FAILED, CANCELLED = "news", "done", "failed", "cancelled"
Job = Callable[[], Generator[Any, None, Any]]


class Event(NamedTuple):
    """What a job reports: NEWS with what it yields that is not None, then DONE with what it returns, FAILED with the error, or CANCELLED."""

    kind: str
    value: Any


class Worker:
    """Runs one generator at a time in a thread; the node's own thread polls what it says. To cancel is to stop iterating."""

    def __init__(self) -> None:
        self._outbox: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._cancelled = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Whether a job runs, or its end has not been polled."""
        return self._thread is not None

    def start(self, job: Job) -> bool:
        """Begins a job; false where one runs already."""
        if self.busy:
            return False
        self._cancelled.clear()
        self._thread = threading.Thread(target=self._run, args=(job,), name="solver", daemon=True)
        self._thread.start()
        return True

    def poll(self) -> Iterator[Event]:
        """What was said since the last call; never waits."""
        while not self._outbox.empty():
            event = self._outbox.get()
            if event.kind != NEWS:
                self._thread = None
            yield event

    def cancel(self, wait_s: float = 0.0) -> None:
        """Ask the job to end at its next news, and wait for that at most `wait_s`."""
        self._cancelled.set()
        if self._thread is not None and wait_s:
            self._thread.join(wait_s)

    def _run(self, job: Job) -> None:
        try:
            self._outbox.put(self._iterate(job()))
        except Exception as error:  # the node lives on and says what happened
            self._outbox.put(Event(FAILED, error))

    def _iterate(self, steps: Generator[Any, None, Any]) -> Event:
        while not self._cancelled.is_set():
            try:
                news = next(steps)
            except StopIteration as stop:
                return Event(DONE, stop.value)
            if news is not None:
                self._outbox.put(Event(NEWS, news))
        steps.close()
        return Event(CANCELLED, None)
