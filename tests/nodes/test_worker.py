"""Claims about the one thread for long work."""

from __future__ import annotations

import threading
import time

import pytest

from diffphys_ros.errors import InputError
from diffphys_ros.nodes.worker import CANCELLED, DONE, FAILED, NEWS, Worker

from .processes import PATIENCE_S


def events(worker: Worker, timeout_s: float = PATIENCE_S) -> list:
    found, until = [], time.monotonic() + timeout_s
    while worker.busy and time.monotonic() < until:
        found += worker.poll()
        time.sleep(0.005)
    return found


def test_news_come_in_order_and_the_result_last():
    def job():
        yield 1
        yield 2
        return "end"

    worker = Worker()
    assert worker.start(job)
    assert events(worker) == [(NEWS, 1), (NEWS, 2), (DONE, "end")]
    assert not worker.busy


def test_to_cancel_is_to_stop_iterating():
    cleaned = threading.Event()

    def endless():
        try:
            while True:
                yield 0
                time.sleep(0.01)
        finally:
            cleaned.set()

    worker = Worker()
    worker.start(endless)
    worker.cancel(PATIENCE_S)
    assert events(worker)[-1] == (CANCELLED, None)
    assert cleaned.is_set()


def test_only_one_job_runs_at_a_time_and_another_may_follow():
    gate = threading.Event()

    def waits():
        yield 0
        gate.wait(PATIENCE_S)

    worker = Worker()
    assert worker.start(waits)
    assert not worker.start(waits)
    gate.set()
    events(worker)
    assert worker.start(waits)
    events(worker)


@pytest.mark.parametrize("error", [InputError("no clip"), ZeroDivisionError("1 / 0")])
def test_errors_are_reported_and_the_worker_lives_on(error):
    def fails():
        yield 0
        raise error

    worker = Worker()
    worker.start(fails)
    assert events(worker)[-1] == (FAILED, error)
    assert worker.start(lambda: iter(()))
    events(worker)
