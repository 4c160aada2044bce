"""The chain of launches on CUDA. The processor only says where arrays lie; it waits for the device once, while the
device still has work, to learn whether the tiles' lists had room."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import torch
import warp as wp

from .cuda_composite import GRADIENT, SPLAT, composite_pairs_backward, composite_tiles, composite_tiles_backward, sum_pairs, vec10
from .cuda_tiles import BLOCK, SCAN_BLOCK, TILE_PX, list_pairs, place_lists, sort_lists
from .project import project, project_backward, sum_frames
from .scene import Rendered, Scene, Tensors
from .view import View

BYTES = 4  # of a float or an int
ROOM = 6  # tiles per Gaussian that are allowed for at first
SPARE = 1.25  # over the room that was needed, when there was too little
KNOWN_SIZES = 16  # numbers of frames and Gaussians for which launches are kept

Arrays = Sequence[Any]  # dtypes, or pairs of dtype and distance from one element to the next in scalars

INT, KEY, FLOAT = wp.int32, wp.int64, wp.float32
# where the parts of a projected Gaussian begin: centre, conic, depth, reach, opacity, color; and those of its gradient
PARTS = (0, 2, 6, 5, 7, 8)
D_PARTS = (0, 2, 5, 6, 7)  # centre, conic, depth, opacity, color
CONIC, DEPTH = PARTS[1], PARTS[2]


class _Step:
    """A launch recorded once; a call says where its arrays lie."""

    def __init__(self, kernel: wp.Kernel, threads: int, numbers: Sequence[Any], arrays: Arrays, device: Any, block: int = BLOCK) -> None:
        self.arrays = [_described(*a) if isinstance(a, tuple) else _described(a) for a in arrays]
        self._launch = wp.launch(kernel, threads, [*numbers, *self.arrays], device=device, block_dim=block, record_cmd=True)

    def __call__(self, stream: wp.Stream, *addresses: int) -> None:
        for array, address in zip(self.arrays, addresses, strict=True):
            array.data = address
        self._launch.launch(stream)


def _described(dtype: Any, distance: int = 0) -> Any:
    """Descriptor of an array whose address is yet to come."""
    real = {INT: torch.int32, KEY: torch.int64, wp.vec4i: torch.int32}.get(dtype, torch.float32)
    width = dtype._shape_[0] if hasattr(dtype, "_shape_") else 1
    row = torch.empty(1, distance or width, dtype=real)[:, :width]
    return wp.from_torch(row if hasattr(dtype, "_shape_") else row[:, 0], dtype=dtype, return_ctype=True)


@dataclass(frozen=True)
class _Steps:
    """All launches for one number of frames and Gaussians."""

    tiles: int
    project: _Step
    place: _Step
    list: _Step
    sort: _Step
    composite: _Step
    backward: _Step
    backward_by_pair: _Step
    sum_pairs: _Step
    project_backward: _Step
    sum_frames: _Step


@dataclass(frozen=True)
class _Kept:
    """Projected Gaussians over frame and Gaussian, and the lists of their tiles."""

    splat: torch.Tensor  # (N, SPLAT)
    box: torch.Tensor  # (5 N,): boxes of tiles, then how many tiles they hold
    start: torch.Tensor
    key: torch.Tensor


class CudaChain:
    """Launches on torch's stream. What is rendered is the same in every run. Gradients are where torch is asked for
    deterministic algorithms (torch.use_deterministic_algorithms), else their sums have no order."""

    def __init__(self, view: View, device: torch.device) -> None:
        self.view, self.device = view, device
        self._steps = lru_cache(KNOWN_SIZES)(self._record)
        self._room = 0
        self._needed = torch.zeros(1, dtype=torch.int32, pin_memory=True)
        self._counted = torch.cuda.Event()
        self._streams: dict[int, wp.Stream] = {}
        self._lock = threading.Lock()  # the steps' addresses belong to one call at a time

    def forward(self, scene: Scene) -> Rendered:
        """Image, alpha and depth."""
        with self._lock:
            return self._forward(scene, self._steps(scene.frames, *scene.counts), *self._stream())

    def backward(self, scene: Scene, rendered: Rendered, cotangents: Sequence[torch.Tensor | None]) -> Tensors:
        """Gradients of mean, rotation, scale, opacity, color from those of image, alpha, depth (None: zero)."""
        with self._lock:
            steps, (stream, _) = self._steps(scene.frames, *scene.counts), self._stream()
            gradient = self._splat_gradient(scene, rendered, cotangents, steps, stream)
            return self._scene_gradient(scene, rendered.kept, gradient, steps, stream)

    def _stream(self) -> tuple[wp.Stream, torch.cuda.Stream]:
        """Torch's own, in both libraries' words: what one writes is there when the other reads."""
        current = torch.cuda.current_stream(self.device)
        if current.cuda_stream not in self._streams:
            self._streams[current.cuda_stream] = wp.stream_from_torch(current)
        return self._streams[current.cuda_stream], current

    def _forward(self, scene: Scene, steps: _Steps, stream: wp.Stream, torchs: torch.cuda.Stream) -> Rendered:
        splat, box = torch.empty(scene.total, SPLAT, device=self.device), torch.empty(5 * scene.total, dtype=torch.int32, device=self.device)
        table = torch.zeros(3, steps.tiles + 1, dtype=torch.int32, device=self.device)
        counts, start, cursor = (table.data_ptr() + BYTES * row * table.shape[1] for row in range(3))
        depth, boxes = splat.data_ptr() + BYTES * DEPTH, _boxes(box)
        given = _addresses(scene.mean, scene.rotation, scene.scale, scene.opacity, scene.color)
        steps.project(stream, *given, *(splat.data_ptr() + BYTES * part for part in PARTS), *boxes, counts)
        shape = (scene.frames, self.view.height, self.view.width)
        images = tuple(torch.empty(*shape, *n, device=self.device) for n in ((3,), (), ()))
        self._room = self._room or ROOM * scene.total
        while True:
            key = torch.empty(self._room, dtype=torch.int64, device=self.device)
            steps.place.arrays[0].shape[0] = steps.list.arrays[-1].shape[0] = len(key)
            steps.place(stream, key.data_ptr(), counts, start, cursor)
            self._needed.copy_(table[2, -1:], non_blocking=True)
            self._counted.record(torchs)
            steps.list(stream, *boxes, depth, cursor, key.data_ptr())
            steps.sort(stream, start, key.data_ptr())
            steps.composite.arrays[3].shape[0] = len(scene.background)
            steps.composite(stream, start, *_addresses(key, splat, scene.background, *images))
            self._counted.synchronize()
            needed = int(self._needed[0])
            if needed <= len(key):
                return Rendered(images, _Kept(splat, box, table[1], key))
            self._room = int(SPARE * needed)

    def _splat_gradient(
        self, scene: Scene, rendered: Rendered, cotangents: Sequence[torch.Tensor | None], steps: _Steps, stream: wp.Stream
    ) -> torch.Tensor:
        """Gradient of the projected Gaussians (N, GRADIENT)."""
        kept: _Kept = rendered.kept
        seen = [c if c is None else c.contiguous() for c in cotangents]
        lists = kept.start, kept.key, kept.splat, scene.background
        arguments = [*_addresses(*lists, *rendered.images), *(0 if c is None else c.data_ptr() for c in seen)]
        repeatable = torch.are_deterministic_algorithms_enabled()
        gradient = torch.zeros(len(kept.key) if repeatable else scene.total, GRADIENT, device=self.device)
        step = steps.backward_by_pair if repeatable else steps.backward
        step.arrays[3].shape[0] = len(scene.background)
        step(stream, *arguments, gradient.data_ptr())
        return self._summed(scene, kept, gradient, steps, stream) if repeatable else gradient

    def _summed(self, scene: Scene, kept: _Kept, pair: torch.Tensor, steps: _Steps, stream: wp.Stream) -> torch.Tensor:
        gradient = torch.empty(scene.total, GRADIENT, device=self.device)
        steps.sum_pairs(stream, *_boxes(kept.box), kept.splat.data_ptr() + BYTES * DEPTH, *_addresses(kept.start, kept.key, pair, gradient))
        return gradient

    def _scene_gradient(self, scene: Scene, kept: _Kept, gradient: torch.Tensor, steps: _Steps, stream: wp.Stream) -> Tensors:
        d_mean, d_rotation, each_scale = torch.empty_like(scene.mean), torch.empty_like(scene.rotation), torch.empty_like(scene.mean)
        shared = tuple(torch.empty_like(t) for t in (scene.scale, scene.opacity, scene.color))
        conic, lengths = kept.splat.data_ptr() + BYTES * CONIC, _boxes(kept.box)[1]
        centre, of_conic, depth, opacity, color = (gradient.data_ptr() + BYTES * part for part in D_PARTS)
        given, outputs = _addresses(scene.mean, scene.rotation, scene.scale), _addresses(d_mean, d_rotation, each_scale)
        steps.project_backward(stream, *given, conic, lengths, centre, of_conic, depth, *outputs)
        steps.sum_frames(stream, each_scale.data_ptr(), opacity, color, *_addresses(*shared))
        return d_mean, d_rotation, *shared

    def _record(self, frames: int, gaussians: int, colors: int) -> _Steps:
        """Record every launch; this compiles the kernels where they are not yet."""
        total, vec = frames * gaussians, {2: wp.vec2, 3: wp.vec3}
        columns, rows = -(-self.view.width // TILE_PX), -(-self.view.height // TILE_PX)
        tiles, window = frames * columns * rows, (self.view.width, self.view.height, columns, rows)
        device, grid = wp.device_from_torch(self.device), (gaussians, columns, rows)

        def step(kernel: wp.Kernel, threads: int, numbers: Sequence[Any], *arrays: Any, block: int = BLOCK) -> _Step:
            return _Step(kernel, threads, numbers, arrays, device, block)

        def row(length: int, *widths: int) -> list[Any]:
            return [(vec.get(w, FLOAT), length) for w in widths]

        given, boxes, pixels = [wp.vec3, wp.vec4, wp.vec3], [wp.vec4i, INT], [INT, KEY, *[FLOAT] * 5]
        projected, backward = [*given, FLOAT, wp.vec3, *row(SPLAT, 2, 3, 1, 1, 1, 3), *boxes, INT], [*pixels, *[FLOAT] * 4]
        returned = [*given, (wp.vec3, SPLAT), INT, *row(GRADIENT, 2, 3, 1), wp.vec3, wp.vec4, wp.vec3]
        return _Steps(
            tiles=tiles,
            project=step(project, total, [self.view, TILE_PX, gaussians, colors], *projected),
            place=step(place_lists, SCAN_BLOCK, [tiles], KEY, INT, INT, INT, block=SCAN_BLOCK),
            list=step(list_pairs, total, grid, *boxes, (FLOAT, SPLAT), INT, KEY),
            sort=step(sort_lists, tiles * BLOCK, [], INT, KEY),
            composite=step(composite_tiles, tiles * BLOCK, window, *pixels),
            backward=step(composite_tiles_backward, tiles * BLOCK, window, *backward),
            backward_by_pair=step(composite_pairs_backward, -(-32 * tiles // BLOCK) * BLOCK, [tiles, *window], *backward),
            sum_pairs=step(sum_pairs, total, grid, *boxes, (FLOAT, SPLAT), INT, KEY, vec10, vec10),
            project_backward=step(project_backward, total, [self.view, gaussians], *returned),
            sum_frames=step(sum_frames, gaussians, [frames, gaussians, colors], wp.vec3, *row(GRADIENT, 1, 3), wp.vec3, FLOAT, wp.vec3),
        )


def _boxes(box: torch.Tensor) -> tuple[int, int]:
    """Addresses of the boxes of tiles and of their counts."""
    return box.data_ptr(), box.data_ptr() + BYTES * (len(box) // 5) * 4


def _addresses(*tensors: torch.Tensor) -> list[int]:
    return [t.data_ptr() for t in tensors]
