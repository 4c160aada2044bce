"""The state of search and training on disk, so that a long fit can be interrupted and resumed."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from .. import __version__, shapes, store
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
        """Reads the file at once where resuming is asked for. Raises InputError where it is absent, damaged or of another version."""
        self.path, self.every_s = path, every_s
        self._saved_at, self._key = time.monotonic(), ""
        self._latest: Stored | None = None
        self._found = _read(path) if resume and path is not None else None

    def bind(self, clip: Clip, settings: Settings) -> None:
        """Say which job the states belong to, as soon as the clip is read; what a job was bound to first holds. Raises InputError where
        the job to resume is another."""
        if self._key:
            return
        words = {k: v for k, v in flat(settings).items() if k not in _FREE}
        digest = hashlib.sha256(json.dumps(words, sort_keys=True).encode())
        digest.update(np.ascontiguousarray(clip.frames[:: max(1, len(clip) // 8)]).tobytes())
        self._key = digest.hexdigest()

        if self._found is not None and str(self._found["key"]) != self._key:
            raise self._another()

    def load(self, size: int, parts: int) -> Stored | None:
        """What was stored, where resuming was asked for: a state of `size` unknowns for a body of `parts`. Raises InputError for another."""
        z = self._found
        if z is None:
            return None
        if len(z["z"]) != size or len(z["captured"]) != parts:
            raise self._another()
        state = Iterate(z["z"], float(z["value"]), z["gradient"], z["inverse"], int(z["iteration"]), int(z["flat"]), tuple(z["history"].tolist()))
        return Stored(state, z["captured"], Training.of(z) if "field_at" in z else None)

    def _another(self) -> InputError:
        return InputError(f"checkpoint {self.path}: belongs to another clip or other settings; repeat those, or leave out --resume (of fit_node: resume)")

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
        fields |= training.arrays() if training else {}
        store.write_arrays(self.path, fields | {_VERSION: np.array(__version__), _DIGEST: np.array(_digest(fields))})
        self._latest, self._saved_at = None, time.monotonic()

    def remove(self) -> None:
        """The job is done: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a checkpoint, whole and of this version. Raises InputError."""
    anew = "leave out --resume (of fit_node: resume) to begin anew"
    if not path.exists():
        raise InputError(f"checkpoint {path}: there is none to resume from; {anew}")
    z = store.read_arrays(path, "checkpoint", cure=anew)
    version, digest = (str(z.pop(name, np.array("none"))) for name in (_VERSION, _DIGEST))
    if version != __version__:
        raise InputError(f"checkpoint {path}: written by version {version[:40]!a} of diffphys_ros, must be {__version__!r}; {anew}")
    try:
        shapes.require(digest == _digest(z), "its arrays are not those that were written")
        sizes = shapes.check(z, _STATE)
        shapes.require(not np.isnan(z["value"]) and not np.isnan(z["history"]).any() and sizes["p"] > 0, "its losses are no numbers")
        if "field_at" in z:
            shapes.check(z, _TRAINING)
    except shapes.MisshapenError as error:
        raise InputError(f"checkpoint {path}: damaged ({error}); {anew}") from error
    return z


def _digest(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of names, types, shapes and bytes."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {np.shape(arrays[name])} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


_VERSION, _DIGEST = "version", "digest"  # of the file, beside the state's arrays
_STATE = {
    "key": "text", "z": "real n", "value": "gap", "gradient": "real n", "inverse": "real n n", "iteration": "whole", "flat": "whole", "history": "gap h",
    "captured": "positive p",
}  # fmt: skip
_TRAINING = {"field_at": "real m", "field_slope": "real m", "field_steps": "real k m", "field_changes": "real k m", "field_value": "gap", "field_material": "truth", "field_history": "gap g"}

# settings that may change between an interrupted run and its continuation
_FREE = ("fit.iterations", "fit.field_iterations", "fit.time_budget_s", "fit.checkpoint_every_s", "playback.rate", "playback.loop", "publish.max_points", "publish.max_markers", "scene.first_mask")
