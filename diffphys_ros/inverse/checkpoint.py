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

from .. import __version__, shapes, store
from ..config import Settings, flat
from ..damping import Damping
from ..errors import InputError
from ..footprints import Footprint
from ..types import Clip, MaterialDoubt, StartValues
from .descent import Descent
from .unknowns import Layout


@dataclass(frozen=True)
class First:
    """What a fit ended with before the place of the force was read again."""

    z: np.ndarray  # (size,)
    value: float  # of the loss
    captured: np.ndarray  # moduli that its substeps were laid out for [Pa], (n,)
    losses: dict[str, list[float]]
    again: StartValues  # that the fit goes on from


@dataclass(frozen=True)
class Stored:
    """Everything from which a fit goes on."""

    stage: int  # which of the schedule's
    z: np.ndarray  # all blocks of the unknowns, as constants and vectors ended or are, (size,)
    descent: Descent  # of the stage
    captured: np.ndarray  # moduli that the substeps were laid out for [Pa], (n,)
    losses: dict[str, list[float]]  # of each state, by the name of its stage
    first: First | None = None  # what came before, where this is of the fit after a second reading

    def check(self) -> None:
        """Holds arrays of unknown origin to shapes and bounds. Raises shapes.MisshapenError."""
        d = self.descent
        sizes = shapes.check({name: getattr(self if name in ("z", "captured") else d, name) for name in _ARRAYS}, _ARRAYS)
        if self.first is not None:
            shapes.check(vars(self.first), {"z": "real z", "captured": "positive p"}, {"p": sizes["p"]})
            shapes.require(np.isfinite(self.first.value), "its numbers are out of bounds")
            shapes.check_start(self.first.again, len(self.first.again.forced), sizes["p"])
        shapes.require(sizes["p"] > 0 and self.stage >= 0 and d.iteration >= 0 and not np.isnan(d.value), "its numbers are out of bounds")


_ARRAYS = {"z": "real n", "captured": "positive p", "at": "real m", "slope": "real m", "steps": "real k m", "changes": "real k m", "value": "gap"}


class Checkpoint:
    """One file that always holds a whole state; `path` None keeps nothing."""

    def __init__(self, path: Path | None, *, every_s: float = 60.0, resume: bool = False):
        """Reads the file at once where resuming is asked for. Raises InputError where it is absent, damaged or of another version."""
        self.path, self.every_s = path, every_s
        self._saved_at, self._key = time.monotonic(), ""
        self._latest: Stored | None = None
        self._found: Stored | None = None
        self._found_key = ""
        self.first: First | None = None  # what states that are offered from now on go on from
        if resume and path is not None:
            self._found_key, self._found = _read(path)
            self.first = self._found.first

    def bind(self, clip: Clip, settings: Settings, *, begun: float = 1.0) -> None:
        """Say which job the states belong to, as soon as the clip is read; what a job was bound to first holds. `begun` is how many times
        off its search begins. Raises InputError where the job to resume is another."""
        if self._key:
            return
        words = {k: v for k, v in flat(settings).items() if k not in _FREE}
        digest = hashlib.sha256(json.dumps([words, begun], sort_keys=True).encode())
        digest.update(np.ascontiguousarray(clip.frames[:: max(1, len(clip) // 8)]).tobytes())
        self._key = digest.hexdigest()

        if self._found is not None and self._found_key != self._key:
            raise self.another()

    def load(self, layout: Layout, stages: int) -> Stored | None:
        """What was stored, where resuming was asked for, of the fit before or after a second reading, whichever `first` says. Raises InputError
        where it is of other unknowns or of more stages than there are."""
        found = self._found if self._found is not None and (self._found.first is None) == (self.first is None) else None
        if found is not None and (len(found.z) != layout.size or len(found.captured) != layout.parts or found.stage >= stages):
            raise self.another()
        return found

    def another(self) -> InputError:
        """What is said of a state that does not fit this job."""
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
        arrays = store.encoded(self._latest) | {_KEY: np.array(self._key)}
        store.write_arrays(self.path, arrays | {_VERSION: np.array(__version__), _DIGEST: np.array(_digest(arrays))})
        self._latest, self._saved_at = None, time.monotonic()

    def remove(self) -> None:
        """The job is done: nothing is left to resume."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


def _read(path: Path) -> tuple[str, Stored]:
    """Key and content of a checkpoint, whole and of this version. Raises InputError."""
    anew = "leave out --resume (of fit_node: resume) to begin anew"
    if not path.exists():
        raise InputError(f"checkpoint {path}: there is none to resume from; {anew}")
    z = store.read_arrays(path, "checkpoint", cure=anew)
    version, digest = (str(z.pop(name, np.array("none"))) for name in (_VERSION, _DIGEST))
    if version != __version__:
        raise InputError(f"checkpoint {path}: written by version {version[:40]!a} of diffphys_ros, must be {__version__!r}; {anew}")
    try:
        shapes.require(digest == _digest(z), "its arrays are not those that were written")
        stored = store.decoded(z, (Stored, First, Descent, StartValues, MaterialDoubt, Damping, Footprint))
        shapes.require(isinstance(stored, Stored) and z[_KEY].dtype.kind == "U", "it holds something else")
        stored.check()
    except (shapes.MisshapenError, store.StrangeError) as error:
        raise InputError(f"checkpoint {path}: damaged ({error}); {anew}") from error
    return str(z[_KEY]), stored


def _digest(arrays: Mapping[str, Any]) -> str:
    """SHA-256 of names, types, shapes and bytes."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {np.shape(arrays[name])} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


_VERSION, _DIGEST, _KEY = "version", "digest", "key"  # of the file, beside the state's arrays

# settings that may change between an interrupted run and its continuation
_FREE = ("fit.iterations", "experiment.field_iterations", "fit.time_budget_s", "experiment.checkpoint_every_s", "playback.rate", "playback.loop", "publish.max_points", "scene.first_mask")
