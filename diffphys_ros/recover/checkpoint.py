"""The state of search and training on disk, so that a long fit can be interrupted and resumed."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .. import store
from ..config import Settings, flat
from ..errors import InputError
from ..types import Clip
from .limited_memory import Descent
from .minimise import Iterate


@dataclass(frozen=True)
class Training:
    """How far the training of fields has come."""

    material: bool  # whether the material is trained, not the force alone
    descent: Descent
    history: tuple[float, ...]  # accepted losses

    def arrays(self) -> dict[str, Any]:
        """As arrays by name."""
        d = self.descent
        tensors = {"field_at": d.at, "field_slope": d.slope, "field_steps": _rows(d.steps, d.at), "field_changes": _rows(d.changes, d.at)}
        numbers = {"field_value": d.value, "field_material": self.material, "field_history": np.array(self.history)}
        return {name: tensor.numpy() for name, tensor in tensors.items()} | numbers

    @classmethod
    def of(cls, stored: dict[str, np.ndarray]) -> Training:
        """The inverse of `arrays`."""
        at, slope, steps, changes = (torch.from_numpy(stored[f"field_{name}"]) for name in ("at", "slope", "steps", "changes"))
        descent = Descent(at, float(stored["field_value"]), slope, tuple(steps), tuple(changes))
        return cls(bool(stored["field_material"]), descent, tuple(stored["field_history"].tolist()))


@dataclass(frozen=True)
class Stored:
    """Everything from which a fit goes on."""

    state: Iterate  # of the search
    captured: np.ndarray  # moduli that the substeps were laid out for [Pa], (n,)
    training: Training | None = None


def _rows(vectors: tuple[torch.Tensor, ...], like: torch.Tensor) -> torch.Tensor:
    return torch.stack(vectors) if vectors else like.new_zeros((0, len(like)))


class Checkpoint:
    """One file that always holds a whole state; `path` None keeps nothing."""

    def __init__(self, path: Path | None, *, every_s: float = 60.0, resume: bool = False):
        self.path, self.every_s, self.resume = path, every_s, resume
        self._saved_at, self._key = time.monotonic(), ""
        self._latest: Stored | None = None

    def bind(self, clip: Clip, settings: Settings) -> None:
        """Say which job the states belong to; a state of another job is refused on resume."""
        words = {k: v for k, v in flat(settings).items() if k not in _FREE}
        digest = hashlib.sha256(json.dumps(words, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(clip.frames[:: max(1, len(clip) // 8)]).tobytes())
        self._key = digest.hexdigest()

    def load(self, size: int) -> Stored | None:
        """What was stored, where resuming was asked for and there is something."""
        if not self.resume or self.path is None:
            return None
        if not self.path.exists():
            raise InputError(f"checkpoint {self.path}: there is none to resume from; leave out --resume (of fit_node: resume) to begin anew")
        z = store.read_arrays(self.path, "checkpoint")
        if str(z["key"]) != self._key or len(z["z"]) != size:
            raise InputError(f"checkpoint {self.path}: belongs to another clip or other settings; repeat those, or leave out --resume (of fit_node: resume)")
        state = Iterate(z["z"], float(z["value"]), z["gradient"], z["inverse"], int(z["iteration"]), int(z["flat"]), tuple(z["history"].tolist()))
        return Stored(state, z["captured"], Training.of(z) if "field_at" in z else None)

    def offer(self, state: Stored) -> None:
        """A new state; written when enough time has passed since the last."""
        self._latest = state
        if time.monotonic() - self._saved_at >= self.every_s:
            self.flush()

    def flush(self) -> None:
        """Write the latest state now."""
        if self.path is None or self._latest is None:
            return
        state, training = self._latest.state, self._latest.training
        fields = {name: getattr(state, name) for name in ("z", "value", "gradient", "inverse", "iteration", "flat")}
        fields |= {"history": np.array(state.history), "captured": self._latest.captured, "key": np.array(self._key)}
        store.write_arrays(self.path, fields | (training.arrays() if training else {}))
        self._latest, self._saved_at = None, time.monotonic()

    def remove(self) -> None:
        """The job is done: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


# settings that may change between an interrupted run and its continuation
_FREE = ("fit.iterations", "fit.field_iterations", "fit.time_budget_s", "fit.checkpoint_every_s", "playback.rate", "playback.loop", "publish.max_points", "publish.max_markers", "scene.first_mask")
