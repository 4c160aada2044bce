"""What the words of a command line stand for: recordings, each with the name of its folder, its settings and its truth."""

from __future__ import annotations

import hashlib
import re
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from .. import result
from ..errors import InputError

GIVEN, TRUTH = "given.yaml", "truth.npz"
BAG_OUTLINE = "metadata.yaml"  # makes a folder a rosbag2 recording
RECORDINGS = (".mcap", ".db3")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
PICTURES = (".png", ".jpg", ".jpeg")
PLAIN_STEMS = ("clip", "recording", "video", "bag")  # say nothing about a clip: the folder's name does
NAME_LENGTH = 60


@dataclass(frozen=True)
class Recording:
    """One clip of a batch."""

    name: str  # of its folder: readable, the same for the same path in every batch, never that of another path
    path: Path  # absolute
    given: Path | None  # settings beside it
    truth: Path | None  # known answer beside it; for the score alone


def find_recordings(words: Iterable[str | Path], *, out: Path) -> list[Recording]:
    """Recordings in order of their names, each once.

    A file is a recording whatever it is called. A folder is a rosbag2 recording, or is searched for such, for .mcap and .db3
    files, videos and prepared clips, or is a folder of pictures; `out` and the results of earlier runs are passed over.
    Raises InputError for a path that does not exist and for a folder that holds no recording.
    """
    found: dict[Path, None] = {}
    for word in words:
        found |= dict.fromkeys(path.resolve() for path in _recordings(Path(word), out.resolve()))
    return sorted((_recording(path) for path in found), key=lambda recording: recording.name)


def is_prepared(path: Path) -> bool:
    """Whether a file says that it is a clip which `diffphys ingest` wrote."""
    return path.suffix == ".npz"


def _recordings(word: Path, out: Path) -> Iterator[Path]:
    try:
        is_file, is_folder = word.is_file(), word.is_dir()
    except (OSError, ValueError) as error:  # a name that is too long, or holds a NUL
        raise InputError(f"clip {str(word)[:80]!r}: {getattr(error, 'strerror', None) or error}; give the path of a recording") from error
    if not is_file and not is_folder:
        raise InputError(f"clip {str(word)[:200]}: no such file or folder; give recordings, or folders that hold some")
    if is_file or _is_bag(word):
        yield word
        return
    below = list(_below(word, out))
    if not below and not any(path.suffix.lower() in PICTURES for path in word.iterdir()):
        raise InputError(f"clip {str(word)[:200]}: no recording lies in this folder; give folders with {', '.join(RECORDINGS + VIDEOS)}, rosbag2 folders or prepared clips")
    yield from below or [word]


def _below(folder: Path, out: Path) -> Iterator[Path]:
    """Recordings in a folder and its folders, by name."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if path.is_dir():
            if path.resolve() == out or path.is_symlink():
                continue
            yield from [path] if _is_bag(path) else _below(path, out)
        elif path.is_file() and _looks_recorded(path):
            yield path


def _looks_recorded(path: Path) -> bool:
    if path.name == result.RECORDING and (path.parent / result.RECOVERY).exists():
        return False
    return path.suffix.lower() in RECORDINGS + VIDEOS or (path.suffix == ".npz" and _holds_outline(path))


def _holds_outline(path: Path) -> bool:
    """Prepared clips are told from truths, results and checkpoints by what is in them."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "outline.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _is_bag(folder: Path) -> bool:
    return (folder / BAG_OUTLINE).exists() and not (folder / result.RECOVERY).exists()


def _recording(path: Path) -> Recording:
    folders = (path, path.parent) if path.is_dir() else (path.parent,)

    def beside(name: str) -> Path | None:
        return next((folder / name for folder in folders if (folder / name).is_file()), None)

    # what a prepared clip was prepared under stands in it
    return Recording(_name(path), path, None if is_prepared(path) else beside(GIVEN), beside(TRUTH))


def _name(path: Path) -> str:
    stem = path.name if path.is_dir() else path.stem
    readable = path.parent.name if stem.lower() in PLAIN_STEMS else stem
    plain = re.sub(r"[^\w.-]+", "_", readable, flags=re.ASCII).strip("._-")[:NAME_LENGTH] or "clip"
    return f"{plain}-{hashlib.sha256(str(path).encode(errors='surrogateescape')).hexdigest()[:8]}"
