"""status.json: how a clip of a batch stands. It is always whole; whoever runs the clip writes it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .. import store

STATUS, LOG = "status.json", "log.txt"
WAITING, RUNNING, DONE, FAILED, TIMED_OUT, INTERRUPTED = STATES = ("waiting", "running", "done", "failed", "timed_out", "interrupted")
BAD = (FAILED, TIMED_OUT)


@dataclass(frozen=True)
class Status:
    """The state of one clip and, where it is done, what came of it."""

    state: str = WAITING
    hash: str = ""  # key.run_key of what is run
    batch: str = ""  # which batch began it: an attempt of the same batch goes on from its checkpoint
    attempts: int = 0  # begun in that batch
    began: str = ""  # UTC, ISO 8601
    ended: str = ""
    seconds: float | None = None  # by the clock, from the start of the last attempt
    processor_s: float | None = None  # of the recovery's process
    memory_mb: float | None = None  # its largest resident size
    exit: int | None = None  # its exit status; below 0: the signal that ended it
    reason: str = ""  # one line: why it is not done, or done without a score
    version: str = ""  # key.program
    versions: str = ""  # of Python and of what computes
    device: str = ""  # name of the GPU or processor
    scored: str = ""  # digest of the truth that the figures are against
    figures: dict[str, Any] = field(default_factory=dict)  # see figures.py

    @property
    def bad(self) -> bool:
        """Whether it ended without a result."""
        return self.state in BAD


def read_status(folder: Path) -> Status | None:
    """The status in a clip's folder; None where there is none that can be read, so that the clip begins anew."""
    try:
        stored = json.loads((folder / STATUS).read_text(encoding="utf-8"))
        known = {f.name: f.type for f in dataclasses.fields(Status)}
        status = Status(**{name: value for name, value in stored.items() if name in known})
    except (OSError, ValueError, AttributeError, RecursionError):
        return None
    whole = status.state in STATES and isinstance(status.figures, dict) and isinstance(status.attempts, int)
    return status if whole and all(isinstance(getattr(status, name), str) for name in ("hash", "batch", "reason", "scored", "version")) else None


def write_status(folder: Path, status: Status) -> None:
    """Put it in place in one step. Raises InputError where the folder cannot be written."""
    text = json.dumps(dataclasses.asdict(status), indent=1) + "\n"
    store.write_whole(folder / STATUS, lambda path: path.write_text(text, encoding="utf-8"))


def now() -> str:
    """Time of day, UTC, ISO 8601 to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")
