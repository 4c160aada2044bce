"""Frozen dataclasses on disk: one .npz of plain arrays and a JSON outline; no pickle, equal bytes for equal content."""

from __future__ import annotations

import dataclasses
import fcntl
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, get_origin

import numpy as np

from . import npz
from .errors import InputError
from .typed import fitting, kinds_of

PART = ".part-"  # what names of files begin with that are not whole yet
DEEPEST = 40  # levels of an outline
_OUTLINE = "outline"


def write_whole(path: str | Path, write: Callable[[Path], object]) -> Path:
    """Let `write(temporary)` make a file beside `path`, then put it in place: the file is there whole or not at all.

    Raises InputError where the folder cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = _begin(path)
    except (OSError, ValueError) as error:
        raise InputError(f"output {path}: {npz.in_words(error)}; choose a folder that can be written") from error
    try:
        write(temporary)
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"output {path}: {error.strerror or error}; free space or choose another folder") from error
    finally:
        temporary.unlink(missing_ok=True)
        os.close(handle)
    return path


def remove_abandoned(folder: Path) -> None:
    """Remove what `write_whole` did not finish in a folder because its process was killed; a file that is being written stays."""
    for path in folder.glob(f"{PART}*"):
        with suppress(OSError), path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            path.unlink()


def _begin(path: Path) -> tuple[int, Path]:
    """An empty temporary file beside `path`, locked as long as the returned handle is open."""
    while True:
        handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=f"{PART}{path.stem}-", dir=path.parent)
        with suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return handle, Path(name)
        os.close(handle)  # taken for abandoned before it was locked


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> Path:
    """A compressed .npz, whole or not at all; np.savez dates its members 1980, so equal arrays give equal bytes.

    Raises ValueError for arrays of Python objects: nothing is pickled.
    """
    objects = [name for name, values in arrays.items() if np.asarray(values).dtype.hasobject]
    if objects:
        raise ValueError(f"arrays {', '.join(objects)} hold Python objects; give numbers, booleans or text")

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)  # numpy 1.26 would store allow_pickle as an array

    return write_whole(path, write)


def read_arrays(path: str | Path, what: str, *, cure: str = "write it again") -> dict[str, np.ndarray]:
    """Every array of an .npz. Raises InputError where there is none or it is damaged; `what` says in words what was looked for, `cure`
    what to do."""
    try:
        return npz.read(path)
    except FileNotFoundError as error:
        raise InputError(f"{what} {path}: no such file; give the path of an existing .npz") from error
    except npz.DamagedError as error:
        raise InputError(f"{what} {path}: not a readable .npz ({error}); {cure}") from error


def flat(value: Any, prefix: str = "") -> dict[str, np.ndarray]:
    """Fields of a dataclass as arrays by name, those of dataclasses in it last, by PREFIX_NAME; what is None is left out."""
    fields = {f"{prefix}{f.name}": getattr(value, f.name) for f in dataclasses.fields(value)}
    inner = {name: field for name, field in fields.items() if dataclasses.is_dataclass(field)}
    plain = {name: np.asarray(field) for name, field in fields.items() if name not in inner and field is not None}
    return plain | {name: array for outer, field in inner.items() for name, array in flat(field, f"{outer}_").items()}


def built(cls: Any, arrays: Mapping[str, np.ndarray], prefix: str = "") -> Any:
    """The dataclass that `flat` took apart. Raises KeyError for an array that is missing and has no default; nothing else is checked."""
    kinds, found = kinds_of(cls), {}
    for field in dataclasses.fields(cls):
        name, kind = f"{prefix}{field.name}", kinds[field.name]
        if dataclasses.is_dataclass(kind):
            found[field.name] = built(kind, arrays, f"{name}_")
        elif name in arrays or field.default is dataclasses.MISSING:
            array = arrays[name]
            found[field.name] = array.item() if array.ndim == 0 else tuple(array.tolist()) if get_origin(kind) is tuple else array
    return cls(**found)


def save(path: str | Path, value: Any) -> Path:
    """Write a dataclass of arrays, scalars, text, tuples, lists, dicts and dataclasses, nested as you like."""
    return write_arrays(path, encoded(value))


def encoded(value: Any) -> dict[str, np.ndarray]:
    """The arrays that stand for a value (see `save`) in a file, its outline among them. Fields of a dataclass with STORED, {name in files:
    own name}, and stored() lie under these names beside those of the dataclass that holds it."""
    arrays: dict[str, np.ndarray] = {}
    outline = _encode(value, arrays)
    return {_OUTLINE: np.array(json.dumps(outline)), **arrays}


class StrangeError(ValueError):
    """Arrays that `encoded` did not make."""


def decoded(arrays: Mapping[str, np.ndarray], classes: Iterable[type]) -> Any:
    """The value that arrays stand for; `classes` are those that may be built. Raises StrangeError."""
    try:
        return _decode(json.loads(str(arrays[_OUTLINE])), arrays, {c.__name__: c for c in classes}, DEEPEST)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:  # json's, and of names and fields that are not ours
        raise StrangeError(npz.in_words(error)) from error


def load(path: str | Path, classes: Iterable[type]) -> Any:
    """What `save` wrote; `classes` are those that may be built. Raises InputError for a file of another kind."""
    arrays = read_arrays(path, "clip")
    if _OUTLINE not in arrays:
        raise InputError(f"clip {path}: holds no prepared clip; write one with 'diffphys ingest CLIP --out clip.npz'")
    try:
        return decoded(arrays, classes)
    except StrangeError as error:
        raise InputError(f"clip {path}: written by another version ({error}); write it again with 'diffphys ingest'") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _encode(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        name = f"array_{len(arrays):03d}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, (tuple, list)):
        return {type(value).__name__: [_encode(item, arrays) for item in value]}
    if isinstance(value, dict):
        return {"dict": {str(key): _encode(item, arrays) for key, item in value.items()}}
    kind = type(value).__name__
    if dataclasses.is_dataclass(value):
        return {"class": kind, "fields": {name: _encode(item, arrays) for name, item in _beside(value)}}
    raise TypeError(f"cannot store a {kind}")


def _beside(value: Any) -> Iterator[tuple[str, Any]]:
    """Fields of a dataclass, and in place of one with STORED those of it."""
    for f in dataclasses.fields(value):
        field = getattr(value, f.name)
        yield from field.stored().items() if hasattr(field, "STORED") else [(f.name, field)]


def _decode(outline: Any, arrays: Mapping[str, np.ndarray], classes: Mapping[str, type], levels: int) -> Any:
    """Raises KeyError, TypeError, ValueError or AttributeError for what `_encode` did not write."""
    if not isinstance(outline, dict):
        return outline
    if not levels:
        raise ValueError(f"more than {DEEPEST} levels")

    def inner(value: Any) -> Any:
        return _decode(value, arrays, classes, levels - 1)

    if "array" in outline:
        return arrays[outline["array"]]
    for kind in (tuple, list):
        if kind.__name__ in outline:
            return kind(inner(item) for item in outline[kind.__name__])
    if "dict" in outline:
        return {key: inner(item) for key, item in outline["dict"].items()}
    cls, fields = classes[outline["class"]], {key: inner(item) for key, item in outline["fields"].items()}
    held = {name: kind for name, kind in kinds_of(cls).items() if hasattr(kind, "STORED")}
    built = {name: fitting(kind, {own: fields.pop(key) for key, own in kind.STORED.items()}) for name, kind in held.items()}
    return fitting(cls, dict(**fields, **built))
