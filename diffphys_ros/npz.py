"""Arrays of an .npz, read with nothing taken on trust: every promise of a header is checked before memory is given to it."""

from __future__ import annotations

import math
import os
import re
import stat
import zipfile
from pathlib import Path
from typing import IO, BinaryIO

import numpy as np

MOST_ARRAYS = 10_000  # in one file
FREE_BYTES, MOST_RATIO = 2**30, 100  # what any file may unpack to, and how often its own size a larger one may on top of that
LONGEST_EMPTY = 10_000_000  # entries along any axis of an array without content
LONGEST_HEADER = 10_000  # bytes
PIECE = 2**20  # bytes that are unpacked at a time
_HEADER = re.compile(
    r"\{'descr': '(?P<kind>[<>=|][biufcSU]\d{1,9})', 'fortran_order': (?P<fortran>True|False), 'shape': \((?P<shape>[\d, ]{0,200})\), *\}\s*"
)


class DamagedError(Exception):
    """Why a file cannot be read, in a few words."""


def read(path: str | Path) -> dict[str, np.ndarray]:
    """Every array of an .npz as numpy writes it: numbers, truth values and text, in the machine's byte order.

    Raises DamagedError with the reason, FileNotFoundError where there is no file.
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            _check_size(members, os.fstat(file.fileno()).st_size)
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    except (DamagedError, FileNotFoundError):
        raise
    except Exception as error:  # whatever a broken archive makes zipfile and zlib raise
        raise DamagedError(in_words(error)) from error


def open_regular(path: str | Path) -> BinaryIO:
    """A file opened for reading; a pipe, socket or device, which may never end, raises DamagedError."""
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise DamagedError("it is no regular file")
    return os.fdopen(handle, "rb")


def in_words(error: BaseException) -> str:
    """An error of a parser in one short line that can be printed."""
    words = "".join(c if c.isprintable() else " " for c in getattr(error, "strerror", None) or str(error))
    words = " ".join(words.split())
    return (words if len(words) <= 100 else words[:97] + "...") or type(error).__name__


def _check_size(members: list[zipfile.ZipInfo], size: int) -> None:
    if len(members) > MOST_ARRAYS or len({member.filename for member in members}) < len(members):
        raise DamagedError(f"it holds more than {MOST_ARRAYS} arrays, or two of one name")
    odd = [m for m in members if not m.filename.endswith(".npy") or m.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)]
    if odd:
        raise DamagedError("it holds something else than numpy's arrays")
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if sum(member.file_size for member in members) > min(FREE_BYTES + MOST_RATIO * size, memory):
        raise DamagedError("it would unpack to more than a file of its size or this machine's memory can hold")


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    with archive.open(member) as stream:
        kind, fortran, shape = _header(stream)
        size = math.prod(shape) * kind.itemsize
        if size != member.file_size - stream.tell():
            raise DamagedError(f"an array of shape {in_words(ValueError(shape))} does not fill its place")
        if size == 0 and max(shape, default=0) > LONGEST_EMPTY:
            raise DamagedError("an empty array is longer than any can be")
        content = np.empty(size, np.uint8)
        for start in range(0, size, PIECE):
            piece = stream.read(min(PIECE, size - start))
            content[start : start + len(piece)] = np.frombuffer(piece, np.uint8)
        stream.read(1)  # the end: the check sum is compared there
    return _sound(content, kind).reshape(shape[::-1] if fortran else shape).transpose(range(len(shape))[::-1] if fortran else range(len(shape)))


def _header(stream: IO[bytes]) -> tuple[np.dtype, bool, tuple[int, ...]]:
    version = np.lib.format.read_magic(stream)
    width = 2 if version == (1, 0) else 4
    length = int.from_bytes(stream.read(width), "little")
    if length > LONGEST_HEADER:
        raise DamagedError("the header of an array is longer than any can be")
    found = _HEADER.fullmatch(stream.read(length).decode("latin-1"))
    if found is None:
        raise DamagedError("an array is of numbers, truth values and text only; one is of another kind")
    return np.dtype(found["kind"]), found["fortran"] == "True", tuple(int(n) for n in found["shape"].replace(" ", "").split(",") if n)


def _sound(content: np.ndarray, kind: np.dtype) -> np.ndarray:
    """Bytes as numbers of a kind, (count,); truth values must be 0 or 1, and text must consist of characters."""
    if kind.itemsize == 0:
        raise DamagedError("an array is of text without length")
    values = content.view(kind)
    values = values.astype(kind.newbyteorder("="), copy=False)
    if kind.kind == "b" and (content > 1).any():
        raise DamagedError("an array of truth values holds others")
    if kind.kind == "U":
        codes = values.view(np.uint32)
        if ((codes > 0x10FFFF) | ((codes >= 0xD800) & (codes < 0xE000))).any():
            raise DamagedError("a text holds what is no character")
    return values
