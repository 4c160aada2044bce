"""Workers on this machine: processes, as many at a time as told."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence

from .job import Job, Running
from .status import Status

POLL_S = 0.1
News = tuple[Job, Status | None]  # None: it has begun


def run_here(jobs: Sequence[Job], *, workers: int, gpus: int) -> Generator[News, None, None]:
    """Runs jobs, `workers` at a time, shared out over `gpus` GPUs. Closing the iterator ends what runs and waits until it has."""
    waiting, running, slots = list(jobs), dict[int, Running](), [*range(workers)]
    try:
        while waiting or running:
            while waiting and slots:
                slot, job = slots.pop(0), waiting.pop(0)
                yield job, None
                running[slot] = Running(job, {"CUDA_VISIBLE_DEVICES": str(slot % gpus)} if gpus > 1 else None)
            for slot, at_work in list(running.items()):
                if status := at_work.poll():
                    del running[slot]
                    slots.append(slot)
                    yield at_work.job, status
            time.sleep(POLL_S)
    finally:
        end(list(running.values()))


def end(running: list[Running]) -> None:
    """Asks jobs to end and waits until they have; a second Ctrl-C kills them."""
    try:
        for at_work in running:
            at_work.interrupt()
        _wait(running)
    except KeyboardInterrupt:
        for at_work in running:
            at_work.kill()
        _wait(running)


def _wait(running: list[Running]) -> None:
    while [at_work for at_work in running if at_work.poll() is None]:
        time.sleep(POLL_S)
