"""The search's state on disk, so that a long fit can be interrupted and resumed."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path

import numpy as np

from .. import store
from ..config import Settings, flat
from ..errors import InputError
from ..types import Clip
from .minimise import Iterate


class Checkpoint:
    """One file that always holds a whole state; `path` None keeps nothing."""

    def __init__(self, path: Path | None, *, every_s: float = 60.0, resume: bool = False):
        self.path, self.every_s, self.resume = path, every_s, resume
        self._saved_at, self._key = time.monotonic(), ""
        self._latest: tuple[Iterate, np.ndarray] | None = None

    def bind(self, clip: Clip, settings: Settings) -> None:
        """Say which job the states belong to; a state of another job is refused on resume."""
        words = {k: v for k, v in flat(settings).items() if k not in _FREE}
        digest = hashlib.sha256(json.dumps(words, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(clip.frames[:: max(1, len(clip) // 8)]).tobytes())
        self._key = digest.hexdigest()

    def load(self, size: int) -> tuple[Iterate, np.ndarray] | None:
        """The stored state and the moduli its substeps were laid out for, where resuming was asked for and there is one."""
        if not self.resume or self.path is None:
            return None
        if not self.path.exists():
            raise InputError(f"checkpoint {self.path}: there is none to resume from; leave out --resume to begin anew")
        z = store.read_arrays(self.path, "checkpoint")
        if str(z["key"]) != self._key or len(z["z"]) != size:
            raise InputError(f"checkpoint {self.path}: belongs to another clip or other settings; repeat those, or leave out --resume")
        state = Iterate(z["z"], float(z["value"]), z["gradient"], z["inverse"], int(z["iteration"]), int(z["flat"]), tuple(z["history"].tolist()))
        return state, z["captured"]

    def offer(self, state: Iterate, captured: np.ndarray) -> None:
        """A new state; written when enough time has passed since the last."""
        self._latest = (state, captured)
        if time.monotonic() - self._saved_at >= self.every_s:
            self.flush()

    def flush(self) -> None:
        """Write the latest state now."""
        if self.path is None or self._latest is None:
            return
        state, captured = self._latest
        fields = {name: getattr(state, name) for name in ("z", "value", "gradient", "inverse", "iteration", "flat")}
        store.write_arrays(self.path, fields | {"history": np.array(state.history), "captured": captured, "key": np.array(self._key)})
        self._latest, self._saved_at = None, time.monotonic()

    def remove(self) -> None:
        """The job is done: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


# settings that may change between an interrupted run and its continuation
_FREE = ("fit.iterations", "fit.field_iterations", "fit.time_budget_s", "fit.checkpoint_every_s", "playback.rate", "playback.loop", "publish.max_points", "publish.max_markers", "scene.first_mask")
