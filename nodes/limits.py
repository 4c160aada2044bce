"""How much of a clip a node keeps."""

from __future__ import annotations

import ctypes
from contextlib import suppress

from diffphys_ros.errors import InputError

from .parameters import Own, Parameters

MAX_MIB = Own("max_mib", 1024, "most of a clip that is kept, in the form in which nodes hand it on [MiB]; 436 frames of 640x480 px with depth and mask")
MAX_FRAMES = 10_000  # of a clip, whatever their size: five minutes at 30 Hz
COLOUR_BYTES, DEPTH_BYTES, LABEL_BYTES = 3, 4, 1  # of a pixel on clip/*
MIB = 2**20


def bounded(parameters: Parameters, name: str, low: float, high: float) -> float:
    """One of a node's own parameters; raises InputError where it is out of range."""
    value = parameters[name]
    if not low <= value <= high:
        raise InputError(f"parameter {name} is {value:g}, must be in {low:g} .. {high:g}; choose a value in this range")
    return value


def give_back_memory() -> None:
    """Return what was freed to the system: images of many sizes leave a heap that glibc keeps otherwise."""
    with suppress(AttributeError, OSError):  # another C library has its own ways
        ctypes.CDLL(None).malloc_trim(0)


def max_bytes(parameters: Parameters) -> int:
    """The parameter max_mib in bytes."""
    return int(bounded(parameters, MAX_MIB.name, 1, MIB)) * MIB
