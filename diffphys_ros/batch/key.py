"""What makes two runs of a clip the same run: the clip's bytes, the settings, the program."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

from .. import __version__, config

BLOCK = 1 << 20  # bytes read at a time
WHOLE = 1 << 26  # bytes up to which a file that a setting names is read; a larger one, a network, goes by name, size and time


def run_key(clip: Path, settings: config.Settings) -> str:
    """Digest (64 hexadecimal digits) of a recording, the settings it is recovered with and the program. Raises OSError."""
    digest = hashlib.sha256(program().encode())
    _add(digest, clip, whole=True)
    leaves = config.leaves()
    for name, value in sorted(config.flat(settings).items()):
        digest.update(json.dumps([name, None if leaves[name].path else value]).encode())
        if leaves[name].path and value:
            _add(digest, Path(value), whole=False)
    return digest.hexdigest()


def file_key(path: Path) -> str:
    """Digest of one file. Raises OSError."""
    digest = hashlib.sha256()
    _add(digest, path, whole=True)
    return digest.hexdigest()


@cache
def program() -> str:
    """Version of this package with a digest of its sources: an edited checkout is another program."""
    package, digest = Path(__file__).resolve().parent.parent, hashlib.sha256()
    # rglob follows no links, and nodes, bags and msg_schemas are links in a checkout
    rooms = [package, *sorted(path for path in package.iterdir() if path.is_dir())]
    for room in rooms:
        for path in sorted(room.glob("*.py") if room == package else room.rglob("*.py")):
            digest.update(f"{room.name}/{path.relative_to(room).as_posix()}\n".encode())
            digest.update(path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:12]}"


def _add(digest: hashlib._Hash, path: Path, *, whole: bool) -> None:
    """A file's bytes, or a folder's files with their names."""
    if path.is_dir():
        for file in sorted(p for p in path.rglob("*") if p.is_file()):
            digest.update(file.relative_to(path).as_posix().encode())
            _add(digest, file, whole=whole)
    elif path.exists():
        about = path.stat()
        digest.update(f"{about.st_size}".encode())
        if not whole and about.st_size > WHOLE:
            digest.update(f"{path.name} {about.st_mtime_ns}".encode())
            return
        with path.open("rb") as stream:
            while block := stream.read(BLOCK):
                digest.update(block)
    else:  # a model's name on a hub, or a file whose absence the run will say
        digest.update(str(path).encode())
