"""A batch from its command line to its summary."""

from __future__ import annotations

import sys
import uuid
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .. import config, result
from ..errors import InputError
from .find import Recording, find_recordings, is_prepared
from .job import Job, is_done
from .key import file_key, program, run_key
from .lock import owned
from .machine import PER_GPU, default_workers, gpus, shared_by
from .pool import News, run_here
from .status import BAD, DONE, FAILED, INTERRUPTED, RUNNING, WAITING, Status, read_status, write_status
from .summary import write_summary

OVER_BUDGET, LEAST_S = 2, 600.0  # time limit of a clip that does not end by its own clock: so often its time, but at least this [s]


@dataclass(frozen=True)
class Request:
    """What a user asks for."""

    clips: tuple[str, ...]
    out: Path
    configs: tuple[Path, ...] = ()
    flags: Mapping[str, Any] | None = None  # settings by dotted name
    words: tuple[str, ...] = ()  # the same as words of the command line
    workers: int | None = None
    timeout_s: float | None = None  # of each clip; None: by its time budget
    shard: tuple[int, int] | None = None  # (i, n): every n-th recording from the i-th on
    resume: bool = False
    address: str | None = None  # of a Ray cluster


def run_batch(request: Request) -> int:
    """Runs every clip, each once, and writes the summary; returns how many ended without a result.

    Raises InputError before any work where the request is wrong, KeyboardInterrupt after the summary where it was interrupted.
    """
    settings = config.layered(request.configs, request.flags)
    recordings = _shard(find_recordings(request.clips, out=request.out), request.shard)
    out = result.check_writable(request.out).resolve()
    with owned(out, request.shard):
        return _Batch(request, settings, recordings, out).run()


class _Batch:
    def __init__(self, request: Request, settings: config.Settings, recordings: Sequence[Recording], out: Path):
        self.request, self.settings, self.recordings, self.out = request, settings, recordings, out
        self.id = uuid.uuid4().hex
        self.statuses: dict[str, Status] = {}
        self.interrupted = False
        self.on_gpu = settings.fit.device != "cpu"
        self.cards = gpus() if self.on_gpu and request.address is None else []
        self.workers = request.workers or default_workers(self.cards)

    @property
    def side_by_side(self) -> int:
        """Clips that share a GPU or a core; of a cluster, whose GPUs are not known here, as many as may."""
        if self.request.address is not None:
            return PER_GPU if self.on_gpu else 1
        return shared_by(min(self.workers, len(self.recordings)), len(self.cards))

    def run(self) -> int:
        jobs = self._planned()
        self._say_what_is_known(jobs)
        try:
            self._work(jobs)
        except KeyboardInterrupt:
            self._settle(jobs)
            done = sum(status.state == DONE for status in self.statuses.values())
            print(f"{done} of {len(self.recordings)} clips are done; the same command with --resume goes on. Summary: {self._summary()}", flush=True)
            raise
        except BaseException:  # a full disc, a cluster that is gone: what is done is done
            self._settle(jobs)
            self._summary()
            raise
        bad = sum(status.bad for status in self.statuses.values())
        print(f"{len(self.recordings) - bad} of {len(self.recordings)} clips are done, {bad} failed. Summary: {self._summary()}", flush=True)
        return bad

    def _planned(self) -> list[Job]:
        """Jobs of the clips that must run; the others' statuses are settled here."""
        jobs, finished = [], []
        for recording in self.recordings:
            folder = self.out / recording.name
            try:
                job = self._job(recording, folder)
            except (InputError, OSError) as error:
                self.statuses[recording.name] = Status(state=FAILED, version=program(), reason=" ".join(str(error).split())[:400])
                result.check_writable(folder)
                write_status(folder, self.statuses[recording.name])
                continue
            former = read_status(folder)
            if former is not None and is_done(former, folder, job.hash):
                finished.append((job, former))
            else:
                jobs.append(job)
        if finished and not self.request.resume:
            raise InputError(f"output folder {self.out}: {len(finished)} of these clips are done in it; keep them with --resume, or choose another folder with --out")
        for job, former in finished:
            self.statuses[job.name] = self._rescored(job, former)
        for job in jobs:
            self._wait(job)
        return jobs

    def _job(self, recording: Recording, folder: Path) -> Job:
        configs = [path.resolve() for path in (*self.request.configs, *([recording.given] if recording.given else []))]
        base = result.stored_settings(recording.path) if is_prepared(recording.path) else {}
        settings = config.layered(configs, self.request.flags, base=base)
        budget_s = settings.fit.time_budget_s or config.LONGEST_BUDGET_S["cuda" if self.cards else "cpu"]
        return Job(
            name=recording.name,
            clip=str(recording.path),
            folder=str(folder),
            configs=tuple(map(str, configs)),
            flags=self.request.words,
            truth=str(recording.truth or ""),
            truth_key=file_key(recording.truth) if recording.truth else "",
            hash=run_key(recording.path, settings),
            version=program(),
            device=settings.fit.device,
            timeout_s=self.request.timeout_s or max(LEAST_S, OVER_BUDGET * self.side_by_side * budget_s),
            side_by_side=self.side_by_side,
            resume=self.request.resume,
            batch=self.id,
            cwd=str(Path.cwd()),
        )

    def _wait(self, job: Job) -> None:
        """Waiting, without forgetting what a checkpoint belongs to."""
        folder = Path(job.folder)
        former = read_status(folder) or Status()
        self.statuses[job.name] = Status(state=WAITING, hash=job.hash, version=job.version)
        result.check_writable(folder)
        write_status(folder, replace(self.statuses[job.name], hash=former.hash))

    def _rescored(self, job: Job, former: Status) -> Status:
        """A finished clip keeps its recovery; a truth that is new or another is scored."""
        if former.scored == job.truth_key:
            return former
        from ..score import score_folder
        from .figures import figures_of

        folder = Path(job.folder)
        try:
            score_folder(folder, job.truth) if job.truth else None
            status = replace(former, figures=figures_of(folder), scored=job.truth_key, reason="")
        except InputError as error:
            status = replace(former, scored="", reason=f"not scored: {error}"[:400])
        write_status(folder, status)
        return status

    def _work(self, jobs: list[Job]) -> None:
        from tqdm import tqdm

        all_of_them = len(self.recordings)
        with tqdm(total=all_of_them, initial=all_of_them - len(jobs), desc="clips", unit="clip") as bar, closing(self._news(jobs)) as news:
            for job, status in news:
                bar.write(_told(job, status), file=sys.stdout)
                sys.stdout.flush()
                self.statuses[job.name] = status or Status(state=RUNNING, hash=job.hash, version=job.version)
                if status:
                    bar.update()
                    self._summary()  # a batch that is killed leaves what is done

    def _news(self, jobs: list[Job]) -> Generator[News, None, None]:
        if self.request.address is not None:
            from .cluster import run_on_ray

            return run_on_ray(jobs, address=self.request.address, workers=self.request.workers, on_gpu=self.on_gpu)
        return run_here(jobs, workers=min(self.workers, max(1, len(jobs))), gpus=len(self.cards))

    def _settle(self, jobs: list[Job]) -> None:
        """After a break: every clip's state from its folder; one that is neither over nor waiting was interrupted."""
        for job in jobs:
            status = read_status(Path(job.folder))
            if status is None or (status.batch != self.id and status.state != WAITING):
                continue
            if status.state == RUNNING:
                status = replace(status, state=INTERRUPTED, reason="--resume goes on")
                write_status(Path(job.folder), status)
            self.statuses[job.name] = status

    def _summary(self) -> Path:
        rows = [(r.name, str(r.path), self.statuses[r.name]) for r in self.recordings]
        return write_summary(self.out, rows, shard=self.request.shard)

    def _say_what_is_known(self, jobs: list[Job]) -> None:
        known = [(name, status) for name, status in self.statuses.items() if status.state in (DONE, *BAD)]
        for name, status in known:
            print(f"{name}: {'done before' if status.state == DONE else status.state + ': ' + status.reason}")
        print(f"{len(jobs)} clips to run", flush=True)


def parse_shard(text: str | None) -> tuple[int, int] | None:
    """`i/n` of the command line, 1 <= i <= n. Raises InputError."""
    if text is None:
        return None
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and len(text) < 16 and 1 <= int(first) <= int(second)):
        raise InputError(f"--shard is {text[:40]!r}, must be I/N with 1 <= I <= N; 2/3 runs the second third of the clips")
    return int(first), int(second)


def positive(name: str, text: str | None, kind: Callable[[str], Any]) -> Any:
    """A number above 0 of the command line, None where it is not given. Raises InputError."""
    if text is None:
        return None
    try:
        value = kind(text)
        if 0 < value < 1e9:
            return value
    except ValueError:
        pass
    raise InputError(f"--{name} is {text[:40]!r}, must be a {'whole ' if kind is int else ''}number above 0 and below 1e9")


def _shard(recordings: list[Recording], shard: tuple[int, int] | None) -> list[Recording]:
    return recordings[shard[0] - 1 :: shard[1]] if shard else recordings


def _told(job: Job, status: Status | None) -> str:
    if status is None:
        return f"{job.name}: begins"
    time = "" if status.seconds is None else f" after {status.seconds:.0f} s"
    return f"{job.name}: {status.state.replace('_', ' ')}{time}{': ' + status.reason if status.reason else ''}"
