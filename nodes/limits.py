"""How much of a clip a node keeps."""

from __future__ import annotations

from .parameters import Own, Parameters

MIB = 2**20
MAX_MIB = Own(
    "max_mib", 1024, "most of a clip that is kept, in the form in which nodes hand it on [MiB]; 436 frames of 640x480 px with depth and mask", low=1, high=MIB
)
MAX_FRAMES = 10_000  # of a clip, whatever their size: five minutes at 30 Hz
COLOUR_BYTES, DEPTH_BYTES, LABEL_BYTES = 3, 4, 1  # of a pixel on clip/*


def max_bytes(parameters: Parameters) -> int:
    """The parameter max_mib in bytes."""
    return int(parameters[MAX_MIB.name]) * MIB
