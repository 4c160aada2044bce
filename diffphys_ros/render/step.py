"""Launches recorded once and repeated with other addresses: what wp.launch does with its arguments costs more than many a kernel."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import torch
import warp as wp

BLOCK = 256  # CUDA threads
INT, KEY, FLOAT = wp.int32, wp.int64, wp.float32

Place = int | tuple[int, int]  # address of an array, 0 where it is missing; where its length matters, that too


class RecordedLaunch:
    """A launch of a kernel that takes numbers first and then arrays. A call says where the arrays lie."""

    def __init__(self, kernel: wp.Kernel, threads: int, numbers: Sequence[Any], arrays: Sequence[Any], device: Any, **options: Any) -> None:
        """`arrays`: dtypes, or pairs of dtype and distance from one element to the next [scalars]; options of wp.launch."""
        self._arrays = [_described(*a) if isinstance(a, tuple) else _described(a) for a in arrays]
        given = len(kernel.adj.args) - len(numbers)
        if options.get("adjoint"):
            options["adj_inputs"] = [*numbers, *self._arrays[given:]]
        self._launch = wp.launch(kernel, threads, [*numbers, *self._arrays[:given]], device=device, record_cmd=True, **options)
        self._lock = threading.Lock()

    def __call__(self, stream: wp.Stream | None, *places: Place) -> None:
        with self._lock:
            for array, place in zip(self._arrays, places, strict=True):
                if isinstance(place, tuple):
                    array.data, array.shape[0] = place
                else:
                    array.data = place
            self._launch.launch(stream)


def _described(dtype: Any, distance: int = 0) -> Any:
    """Descriptor of an array whose address is yet to come."""
    real = {INT: torch.int32, KEY: torch.int64, wp.vec4i: torch.int32}.get(dtype, torch.float32)
    width = dtype._shape_[0] if hasattr(dtype, "_shape_") else 1
    row = torch.empty(1, distance or width, dtype=real)[:, :width]
    return wp.from_torch(row if hasattr(dtype, "_shape_") else row[:, 0], dtype=dtype, return_ctype=True)


def addresses(*tensors: torch.Tensor) -> list[int]:
    """Where tensors lie."""
    return [t.data_ptr() for t in tensors]


def stream_of(device: torch.device) -> wp.Stream | None:
    """Torch's stream in Warp's words, so that what one writes is there when the other reads; None on the CPU."""
    return _wrapped(torch.cuda.current_stream(device)) if device.type == "cuda" else None


@lru_cache(64)
def _wrapped(stream: torch.cuda.Stream) -> wp.Stream:
    return wp.stream_from_torch(stream)
