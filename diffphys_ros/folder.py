"""Folders that hold a set of files: one process owns one at a time, and its files are replaced together.

New files are written in a hidden folder first. It gets its final hidden name by one rename, from which moment the new set counts; then its
files move to their places. A process that is killed before that rename leaves the old set, one that is killed after it leaves the new set:
`current` finds it, and the next owner brings it in place.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import InputError
from .npz import in_words
from .store import remove_abandoned

LOCK, STAGING, READY = ".lock", ".staging", ".ready"  # hidden names in a folder that is owned
GONE = ".gone"  # in READY: names that the new set does not have, one a line
_OLDER = re.compile(r"\.(recovery|metrics|summary|checkpoint)-[a-z0-9_]{8}(\.\w+)?")  # unfinished files of versions before store.PART, and recordings


def check_writable(folder: str | Path) -> Path:
    """Make `folder` and prove that a file can be written in it. Raises InputError; call it before any work."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        raise InputError(f"output folder {folder}: {in_words(error)}; choose a folder that can be written with --out") from error
    return folder


@contextmanager
def owned(folder: str | Path, *, files: Collection[str] = ()) -> Iterator[Path]:
    """Own a folder, which is made where there is none, for as long as the context lasts or the process lives.

    What killed owners left behind is brought in order first. Raises InputError where another process or thread owns it, where it
    cannot be written, or where one of `files` is a folder.
    """
    folder = check_writable(folder)
    for name in files:
        if (folder / name).is_dir():
            raise InputError(f"output folder {folder}: {name} in it is a folder, must be a file or absent; choose another folder with --out")
    handle = _lock(folder)
    try:
        _settle(folder)
        try:
            yield folder
        finally:
            _settle(folder)
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        os.close(handle)


@contextmanager
def replaced(folder: str | Path, files: Collection[str], *, then: str = "") -> Iterator[Path]:
    """Replace the set of `files` of a folder that this process owns: write the new ones into the folder that the context gives.

    They take the place of all of `files` when the context ends, and nothing changes where it raises. Raises InputError where the
    disc is full; `then` ends its sentence.
    """
    folder = check_writable(folder)
    staging = folder / STAGING
    try:
        _settle(folder)
        staging.mkdir()
        yield staging
        written = {path.name for path in staging.iterdir()}
        (staging / GONE).write_text("".join(f"{name}\n" for name in files if name not in written), encoding="utf-8")
        for path in (*staging.iterdir(), staging):
            _to_disc(path)
        os.rename(staging, folder / READY)
    except (OSError, InputError) as error:
        cause = error if isinstance(error, OSError) else error.__cause__
        if not isinstance(cause, OSError):
            raise
        raise InputError(f"output folder {folder}: {in_words(cause)}; what it held before is untouched: free space or choose another folder{then}") from error
    finally:
        _remove(staging)
    _publish(folder)


def current(folder: str | Path, name: str) -> Path:
    """Where the file of the set that counts lies: of one that a killed process has not brought in place yet, too."""
    ready = Path(folder) / READY / name
    return ready if ready.exists() else Path(folder) / name


def _lock(folder: Path) -> int:
    """The open lock file. The lock dies with its process; its owner deletes the file, so a lock on a deleted one counts for nothing."""
    path = folder / LOCK
    try:
        while True:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666)
            if _holds(handle, path):
                return handle
            os.close(handle)
    except BlockingIOError as error:
        raise InputError(f"output folder {folder}: another run owns it; wait until that has ended, or choose another folder with --out") from error
    except OSError as error:
        raise InputError(f"output folder {folder}: cannot be locked ({in_words(error)}); choose a folder on a file system with locks") from error


def _holds(handle: int, path: Path) -> bool:
    """Whether the file is locked now and still the one at `path`. Raises BlockingIOError where another holds it."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(handle)
        raise
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _settle(folder: Path) -> None:
    """Ends what was begun: no half-written files, and a new set that counts in its place."""
    try:
        if (folder / READY).is_dir():
            _publish(folder)
        remove_abandoned(folder)
        for path in folder.iterdir():
            if path.name == STAGING or _OLDER.fullmatch(path.name):
                _remove(path)
    except OSError as error:
        raise InputError(f"output folder {folder}: {in_words(error)}; choose another folder with --out") from error


def _publish(folder: Path) -> None:
    ready = folder / READY
    gone = ready / GONE
    for name in gone.read_text(encoding="utf-8").splitlines() if gone.exists() else ():
        (folder / Path(name).name).unlink(missing_ok=True)
    for path in ready.iterdir():
        if path != gone:
            os.replace(path, folder / path.name)
    gone.unlink(missing_ok=True)
    ready.rmdir()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _to_disc(path: Path) -> None:
    """Some file systems notice only here that they are full."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
