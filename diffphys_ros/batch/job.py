"""One clip's task: the recovery and its score, each in a process of its own, watched until it ends."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from .. import result
from ..errors import InputError
from .figures import figures_of
from .process import Ended, Process
from .status import DONE, FAILED, INTERRUPTED, LOG, RUNNING, TIMED_OUT, Status, now, read_status, write_status

GRACE_S = 10.0  # from the request to end until it is killed
SCORE_S = 600.0  # longest time for a score
MAX_ATTEMPTS = 3  # in one batch, where the worker or its machine dies under a clip
REASON_LENGTH = 400
TAIL = 8192  # bytes of the log in which the reason is looked for


@dataclass(frozen=True)
class Job:
    """Everything that a worker needs to run one clip; plain text and numbers, so that it travels."""

    name: str
    clip: str
    folder: str
    configs: tuple[str, ...]
    flags: tuple[str, ...]  # words of the command line
    truth: str  # empty where there is none
    truth_key: str
    hash: str
    version: str
    device: str  # fit.device
    timeout_s: float
    resume: bool
    batch: str
    cwd: str  # what relative paths in `flags` start from
    side_by_side: int = 1  # clips that share its core or GPU: each has so many times its time

    def recover_words(self, *, resume: bool) -> list[str]:
        """`diffphys` words of the recovery."""
        configs = [word for path in self.configs for word in ("--config", path)]
        shared = ["--side_by_side", str(self.side_by_side)] if self.side_by_side > 1 else []
        return ["recover", self.clip, "--out", self.folder, *configs, *shared, *self.flags, *(["--resume"] if resume else [])]


class Running:
    """A job that has begun. `poll` until it gives a status; what it gives stands in status.json as well."""

    def __init__(self, job: Job, environment: Mapping[str, str] | None = None):
        self.job, self.folder, self.log = job, Path(job.folder), Path(job.folder) / LOG
        self._environment = dict(environment or {})
        self._began, self._deadline, self._kill_at = time.monotonic(), time.monotonic() + job.timeout_s, float("inf")
        self._stopped = ""  # the state that it is being stopped for
        self._process: Process | None = None
        self._scoring: Process | None = None
        self._resumed, self._log_from = False, 0
        self.status = Status(state=RUNNING, hash=job.hash, batch=job.batch, version=job.version, began=now())
        self._over: Status | None = None
        try:
            self._begin()
        except (OSError, InputError) as error:
            self._end(FAILED, _line(str(error)))

    def poll(self) -> Status | None:
        """The final status, or None while the clip is being run."""
        if self._over is None:
            self._watch()
        return self._over

    def interrupt(self) -> None:
        """Ask it to end; `poll` goes on until it has."""
        self._stop(INTERRUPTED)

    def kill(self) -> None:
        """End it now."""
        self._stopped = self._stopped or INTERRUPTED
        for process in filter(None, (self._process, self._scoring)):
            process.kill()

    def _begin(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        former = read_status(self.folder) or Status()
        again = former.batch == self.job.batch
        attempts = former.attempts + 1 if again else 1
        self.status = replace(self.status, attempts=attempts)
        if attempts > MAX_ATTEMPTS:
            self._end(FAILED, f"its worker died {MAX_ATTEMPTS} times; see {LOG} and the memory of the machines")
            return
        resume = (self.folder / result.CHECKPOINT).exists() and former.hash == self.job.hash and (self.job.resume or again)
        # a folder never holds the result of another run than its status tells of
        for name in (*result.FILES, *([] if resume else [result.CHECKPOINT])):
            (self.folder / name).unlink(missing_ok=True)
        write_status(self.folder, self.status)
        self._recover(resume=resume, keep_log=resume or again)

    def _recover(self, *, resume: bool, keep_log: bool) -> None:
        if not keep_log:
            self.log.unlink(missing_ok=True)
        self._log_from = self.log.stat().st_size if self.log.exists() else 0
        self._resumed = resume
        self._process = self._started(self.job.recover_words(resume=resume))

    def _started(self, words: list[str]) -> Process:
        return Process(words, self.log, cwd=self.job.cwd, device=self.job.device, environment=self._environment)

    def _watch(self) -> None:
        process = self._scoring or self._process
        assert process is not None
        ended = process.poll()
        if ended is None:
            self._look_at_the_clock()
        elif process is self._scoring:
            process.report()
            self._scored(ended)
        else:
            about = process.report()
            self.status = replace(self.status, processor_s=ended.processor_s, memory_mb=ended.memory_mb, exit=ended.exit, **about)
            self._recovered(ended)

    def _look_at_the_clock(self) -> None:
        at = time.monotonic()
        if at > self._kill_at:
            self.kill()
        elif at > self._deadline:
            self._stop(TIMED_OUT)

    def _stop(self, state: str) -> None:
        if self._stopped or self._over:
            return
        self._stopped, self._kill_at = state, time.monotonic() + GRACE_S
        for process in filter(None, (self._process, self._scoring)):
            process.ask()

    def _recovered(self, ended: Ended) -> None:
        reason = self._reason(ended)
        if ended.exit == 0:
            self._check_result()
        elif self._stopped == TIMED_OUT:
            self._end(TIMED_OUT, f"not done after {self.job.timeout_s:g} s; raise --timeout_s or lower fit.time_budget_s")
        elif self._stopped:
            self._end(INTERRUPTED, "--resume goes on")
        elif self._resumed and ended.exit == 2 and result.CHECKPOINT in reason:
            (self.folder / result.CHECKPOINT).unlink(missing_ok=True)
            self._try(lambda: self._recover(resume=False, keep_log=True))
        else:
            self._end(FAILED, reason)

    def _check_result(self) -> None:
        """A clip is done where its files are; exit status 0 alone says nothing."""
        try:
            figures = figures_of(self.folder)
        except InputError as error:
            self._end(FAILED, _line(str(error)))
            return
        self.status = replace(self.status, figures=figures)
        if self.job.truth:
            self._try(self._score)
        else:
            self._end(DONE, "")

    def _score(self) -> None:
        self._deadline = time.monotonic() + SCORE_S
        self._log_from = self.log.stat().st_size
        self._scoring = self._started(["score", self.job.folder, "--truth", self.job.truth])
        if self._stopped:
            self._scoring.ask()

    def _scored(self, ended: Ended) -> None:
        if ended.exit == 0:
            self.status = replace(self.status, figures=figures_of(self.folder), scored=self.job.truth_key)
            self._end(DONE, "")
        else:
            self._end(DONE, f"not scored: {self._reason(ended)}"[:REASON_LENGTH])

    def _try(self, step) -> None:  # type: ignore[no-untyped-def]
        try:
            step()
        except OSError as error:
            self._end(FAILED, _line(str(error)))

    def _end(self, state: str, reason: str) -> None:
        self.status = replace(self.status, state=state, ended=now(), seconds=round(time.monotonic() - self._began, 1), reason=reason)
        try:
            write_status(self.folder, self.status)
        except InputError as error:
            if state == DONE:  # the next run would not know
                self.status = replace(self.status, state=FAILED, reason=_line(str(error)))
        self._over = self.status

    def _reason(self, ended: Ended) -> str:
        said = self._last_line()
        if ended.exit < 0:
            name = signal.Signals(-ended.exit).name
            cause = ", as the system does when memory runs out" if name == "SIGKILL" else ""
            return f"ended by {name}{cause}; see {LOG}"
        if ended.exit == 2 and said.startswith("diffphys: "):
            return said.removeprefix("diffphys: ")
        return _line(f"ended with status {ended.exit}: {said}" if said else f"ended with status {ended.exit} without a word; see {LOG}")

    def _last_line(self) -> str:
        with suppress(OSError), self.log.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(self._log_from, size - TAIL))
            lines = [line.strip() for line in re.split(r"[\r\n]+", file.read().decode(errors="replace"))]
            return _line(next((line for line in reversed(lines) if line), ""))
        return ""


def is_done(status: Status | None, folder: Path, key: str) -> bool:
    """Whether a clip need not run again: its status says so for the same clip, settings and program, and its result is there."""
    return status is not None and status.state == DONE and status.hash == key and (folder / result.RECOVERY).is_file() and (folder / result.METRICS).is_file()


def _line(text: str) -> str:
    return " ".join(text.split())[:REASON_LENGTH]
