"""Arrays that a node and the process that works for it see in the same memory."""

from __future__ import annotations

import math
import mmap
import os
import weakref
from typing import Any, NamedTuple

import numpy as np


class Place(NamedTuple):
    """Where bytes lie in a file of memory that nobody else can open."""

    file: int
    offset: int


class _Region(NamedTuple):
    file: int
    size: int


_regions: dict[int, _Region] = {}  # by address


def shared_zeros(shape: tuple[int, ...], dtype: Any) -> np.ndarray:
    """Zeros in memory that can be shared; it goes when no array lies there any more."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if not size:
        return np.zeros(shape, dtype)
    file = os.memfd_create("array")
    memory = mmap.mmap(file, _sized(file, size))
    array = np.frombuffer(memory, dtype).reshape(shape)
    _regions[array.ctypes.data] = _Region(file, size)
    weakref.finalize(memory, _forget, array.ctypes.data, file)
    return array


def place_of(content: Any) -> Place | None:
    """Where a buffer lies; None where it is not in memory that is shared."""
    seen = np.frombuffer(content, np.uint8)
    begin = seen.ctypes.data
    return next((Place(region.file, begin - address) for address, region in list(_regions.items()) if address <= begin and begin + len(seen) <= address + region.size), None)


def mapped(place: Place, size: int) -> memoryview:
    """The bytes as this process sees them: what it writes there is its own."""
    memory = mmap.mmap(place.file, 0, flags=mmap.MAP_PRIVATE)
    return memoryview(memory)[place.offset : place.offset + size]


def _sized(file: int, size: int) -> int:
    os.ftruncate(file, size)
    return size


def _forget(address: int, file: int) -> None:
    del _regions[address]
    os.close(file)
