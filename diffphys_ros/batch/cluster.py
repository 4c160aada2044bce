"""Workers of a Ray cluster: the same jobs, one task each. The clips and --out lie on a file system that every node sees at the same path."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from .job import GRACE_S, MAX_ATTEMPTS, Job, Running
from .machine import PER_GPU
from .pool import POLL_S, News, end
from .process import PACKAGE_ROOT
from .status import FAILED, RUNNING, Status, read_status

LISTEN_LIMIT_S = 5.0  # for a cluster's door to open
LISTEN_S = 0.5  # between two looks at what the tasks say


def run_on_ray(jobs: Sequence[Job], *, address: str, workers: int | None, on_gpu: bool) -> Generator[News, None, None]:
    """Runs jobs on the cluster at `address` (auto, host:port; local: one that lives as long as this batch).

    A task takes one core, or, where `on_gpu` and the cluster has GPUs, one core and a PER_GPU-th of a GPU. Where its worker or node
    dies it runs again, at most MAX_ATTEMPTS times in all. At most `workers` tasks are out at a time; None: as many as there are.
    Closing the iterator ends what runs. Raises InputError where there is no Ray or no cluster.
    """
    ray = _connected(address, workers)
    try:
        share = {"num_cpus": 1, "num_gpus": 1 / PER_GPU} if on_gpu and ray.cluster_resources().get("GPU") else {"num_cpus": 1}
        # attempts are counted in status.json: one more here, so that the last one says so
        task = ray.remote(**share, max_retries=MAX_ATTEMPTS)(run_job)
        yield from _watched(ray, task, list(jobs), workers or len(jobs))
    finally:
        ray.shutdown()


def run_job(job: Job) -> Status:
    """On the worker: one clip from beginning to end."""
    running = Running(job)
    try:
        while (status := running.poll()) is None:
            time.sleep(POLL_S)
    except BaseException:  # Ray cancels with KeyboardInterrupt, a node that leaves with SystemExit
        end([running])
        raise
    return status


def _watched(ray: Any, task: Any, waiting: list[Job], at_once: int) -> Generator[News, None, None]:
    out: dict[Any, Job] = {}
    begun: set[str] = set()
    try:
        while waiting or out:
            while waiting and len(out) < at_once:
                job = waiting.pop(0)
                out[task.remote(job)] = job
            over, _ = ray.wait(list(out), timeout=LISTEN_S)
            for job in [job for job in out.values() if job.name not in begun and _has_begun(job)]:
                begun.add(job.name)
                yield job, None
            for one in over:
                job = out.pop(one)
                yield job, _outcome(ray, one, job)
    finally:
        _cancel(ray, out)


def _has_begun(job: Job) -> bool:
    status = read_status(Path(job.folder))
    return status is not None and status.batch == job.batch


def _outcome(ray: Any, one: Any, job: Job) -> Status:
    try:
        return ray.get(one)
    except ray.exceptions.RayError as error:
        last = read_status(Path(job.folder))
        said = " ".join(str(error).split())[:200]
        reason = f"its task on the cluster was lost ({type(error).__name__}: {said}); see the cluster's log"
        return Status(state=FAILED, hash=job.hash, batch=job.batch, version=job.version, attempts=last.attempts if last else 0, reason=reason)


def _cancel(ray: Any, out: dict[Any, Job]) -> None:
    """Tasks end as after Ctrl-C; those that do not in time are killed, and their processes with them."""
    if not out:
        return
    try:
        for one in out:
            ray.cancel(one, force=False)
        limit = time.monotonic() + GRACE_S + 5
        while time.monotonic() < limit and any(_at_work(job) for job in out.values()):
            time.sleep(LISTEN_S)
    finally:
        for one in [one for one, job in out.items() if _at_work(job)]:
            ray.cancel(one, force=True)


def _at_work(job: Job) -> bool:
    status = read_status(Path(job.folder))
    return status is not None and status.batch == job.batch and status.state == RUNNING


def _connected(address: str, workers: int | None) -> Any:
    if ":" in address and "://" not in address:
        _answers(address)
    os.environ.setdefault("RAY_NUM_REDIS_GET_RETRIES", "1")  # of half a minute each; Ray's twenty are ten minutes without a word
    try:
        import ray
    except ImportError as error:
        raise InputError("--address needs Ray, which is not installed; install diffphys_ros[ray], or leave out --address") from error
    path = os.pathsep.join(filter(None, [str(PACKAGE_ROOT), os.environ.get("PYTHONPATH", "")]))
    options: dict[str, Any] = {"num_cpus": workers} if address == "local" and workers else {}
    try:
        ray.init(address=address, log_to_driver=False, include_dashboard=False if address == "local" else None, runtime_env={"env_vars": {"PYTHONPATH": path}}, **options)
    except (ConnectionError, ValueError, RuntimeError, OSError, ray.exceptions.RayError) as error:
        raise _no_cluster(address, error) from error
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ray.init takes it for itself
    return ray


def _answers(address: str) -> None:
    """Raises InputError where nothing listens."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host, int(port)), timeout=LISTEN_LIMIT_S).close()
    except (OSError, ValueError, OverflowError) as error:
        raise _no_cluster(address, error) from error


def _no_cluster(address: str, error: Exception) -> InputError:
    said = " ".join(str(error).split())[:160]
    return InputError(f"--address {address[:80]}: no Ray cluster answers there ({said}); start one with 'ray start --head', or give 'local'")
