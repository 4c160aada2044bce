"""Answers of a model on disk, by the content of what was asked."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ..config import read_text
from ..errors import InputError
from ..store import write_whole
from .endpoint import LARGEST_ANSWER, Message

LARGEST_FILE = 6 * LARGEST_ANSWER + 100  # bytes: a character of the answer takes at most six, as \u0000


def default_folder() -> Path:
    """$XDG_CACHE_HOME/diffphys_ros/prior, in ~/.cache where that is not set."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "diffphys_ros" / "prior"


@dataclass(frozen=True)
class Cache:
    """One file per question. A folder that cannot be read or written only costs asking again."""

    folder: Path

    def get(self, key: str) -> str | None:
        """The stored answer, if there is a readable one."""
        try:
            answer = json.loads(read_text(self.folder / f"{key}.json", "a cached answer", largest=LARGEST_FILE))["answer"]
        except (InputError, ValueError, KeyError, TypeError, RecursionError):
            return None
        return answer if isinstance(answer, str) else None

    def put(self, key: str, answer: str) -> None:
        """Store an answer, whole or not at all."""
        try:
            write_whole(self.folder / f"{key}.json", lambda path: path.write_text(json.dumps({"answer": answer}), encoding="utf-8"))
        except InputError:
            return


def key_of(base_url: str, model: str, messages: Sequence[Message]) -> str:
    """SHA-256 of everything that the answer depends on: endpoint, model, words and images."""
    return hashlib.sha256(json.dumps([base_url, model, list(messages)], sort_keys=True).encode()).hexdigest()
