"""The chain of launches on CUDA. The processor only says where arrays lie; it waits for the device once, while the
device still has work, to learn whether the tiles' lists had room."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import torch
import warp as wp

from .cuda_composite import (
    GRADIENT,
    PARTS,
    SPLAT,
    WARP,
    composite_pairs_backward,
    composite_tiles,
    composite_tiles_backward,
    sum_pairs,
    vec10,
)
from .cuda_tiles import SCAN_BLOCK, TILE_PX, list_pairs, place_lists, sort_lists
from .project import project, project_backward, sum_frames
from .scene import Rendered, Scene, Tensors
from .step import BLOCK, FLOAT, INT, KEY, Place, RecordedLaunch, addresses, stream_of
from .view import View

BYTES = 4  # of a float or an int
ROOM = 6  # tiles per Gaussian that are allowed for at first
SPARE = 1.25  # over the room that was needed, when there was too little
KNOWN_SIZES = 16  # numbers of frames and Gaussians for which launches are kept

# where the fields of a projected Gaussian begin: centre, conic, depth, reach, opacity, color; and those of its gradient
FIELDS = (0, 2, 6, 5, 7, 8)
D_FIELDS = (0, 2, 5, 6, 7)  # centre, conic, depth, opacity, color
CONIC, DEPTH = FIELDS[1], FIELDS[2]


@dataclass(frozen=True)
class _Steps:
    """All launches for one number of frames and Gaussians."""

    tiles: int
    project: RecordedLaunch
    place: RecordedLaunch
    list: RecordedLaunch
    sort: RecordedLaunch
    composite: RecordedLaunch
    backward: RecordedLaunch
    backward_by_pair: RecordedLaunch
    sum_pairs: RecordedLaunch
    project_backward: RecordedLaunch
    sum_frames: RecordedLaunch


class _Kept(NamedTuple):
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
        self._lock = threading.Lock()  # one call at a time asks how much room it needs

    def forward(self, scene: Scene) -> Rendered:
        """Image, alpha and depth."""
        with self._lock:
            return self._forward(scene, self._steps(scene.frames, *scene.counts), stream_of(self.device))

    def backward(self, scene: Scene, rendered: Rendered, cotangents: Sequence[torch.Tensor | None]) -> Tensors:
        """Gradients of mean, rotation, scale, opacity, color from those of image, alpha, depth (None: zero)."""
        steps, stream = self._steps(scene.frames, *scene.counts), stream_of(self.device)
        gradient = self._splat_gradient(scene, rendered, cotangents, steps, stream)
        return self._scene_gradient(scene, _Kept(*rendered.kept), gradient, steps, stream)

    def _forward(self, scene: Scene, steps: _Steps, stream: wp.Stream | None) -> Rendered:
        splat = torch.empty(scene.total, SPLAT, device=self.device)
        box = torch.empty(5 * scene.total, dtype=torch.int32, device=self.device)
        table = torch.zeros(3, steps.tiles + 1, dtype=torch.int32, device=self.device)
        counts, start, cursor = (table.data_ptr() + BYTES * row * table.shape[1] for row in range(3))
        depth, boxes = splat.data_ptr() + BYTES * DEPTH, _boxes(box)
        given = addresses(scene.mean, scene.rotation, scene.scale, scene.opacity, scene.color)
        steps.project(stream, *given, *(splat.data_ptr() + BYTES * field for field in FIELDS), *boxes, counts)
        shape = (scene.frames, self.view.height, self.view.width)
        images = tuple(torch.empty(*shape, *n, device=self.device) for n in ((3,), (), ()))
        self._room = self._room or ROOM * scene.total
        while True:
            key = torch.empty(self._room, dtype=torch.int64, device=self.device)
            room = key.data_ptr(), len(key)
            steps.place(stream, room, counts, start, cursor)
            self._needed.copy_(table[2, -1:], non_blocking=True)
            self._counted.record(torch.cuda.current_stream(self.device))
            steps.list(stream, *boxes, depth, cursor, room)
            steps.sort(stream, start, key.data_ptr())
            steps.composite(stream, start, *addresses(key, splat), _background(scene), *addresses(*images))
            self._counted.synchronize()
            needed = int(self._needed[0])
            if needed <= len(key):
                return Rendered(images, _Kept(splat, box, table[1], key[:needed]))
            self._room = int(SPARE * needed)

    def _splat_gradient(
        self, scene: Scene, rendered: Rendered, cotangents: Sequence[torch.Tensor | None], steps: _Steps, stream: wp.Stream | None
    ) -> torch.Tensor:
        """Gradient of the projected Gaussians (N, GRADIENT)."""
        kept = _Kept(*rendered.kept)
        seen = [c if c is None else c.contiguous() for c in cotangents]
        lists: list[Place] = [*addresses(kept.start, kept.key, kept.splat), _background(scene)]
        cotangent = [0 if c is None else c.data_ptr() for c in seen]
        repeatable = torch.are_deterministic_algorithms_enabled()
        gradient = torch.zeros(len(kept.key) if repeatable else scene.total, GRADIENT, device=self.device)
        step = steps.backward_by_pair if repeatable else steps.backward
        step(stream, *lists, *addresses(*rendered.images), *cotangent, gradient.data_ptr())
        return self._summed(scene, kept, gradient, steps, stream) if repeatable else gradient

    def _summed(self, scene: Scene, kept: _Kept, pair: torch.Tensor, steps: _Steps, stream: wp.Stream | None) -> torch.Tensor:
        gradient = torch.empty(scene.total, GRADIENT, device=self.device)
        steps.sum_pairs(stream, *_boxes(kept.box), kept.splat.data_ptr() + BYTES * DEPTH, *addresses(kept.start, kept.key, pair, gradient))
        return gradient

    def _scene_gradient(self, scene: Scene, kept: _Kept, gradient: torch.Tensor, steps: _Steps, stream: wp.Stream | None) -> Tensors:
        d_mean, d_rotation, each_scale = torch.empty_like(scene.mean), torch.empty_like(scene.rotation), torch.empty_like(scene.mean)
        shared = tuple(torch.empty_like(t) for t in (scene.scale, scene.opacity, scene.color))
        conic, lengths = kept.splat.data_ptr() + BYTES * CONIC, _boxes(kept.box)[1]
        centre, of_conic, depth, opacity, color = (gradient.data_ptr() + BYTES * field for field in D_FIELDS)
        given, outputs = addresses(scene.mean, scene.rotation, scene.scale), addresses(d_mean, d_rotation, each_scale)
        steps.project_backward(stream, *given, conic, lengths, centre, of_conic, depth, *outputs)
        steps.sum_frames(stream, each_scale.data_ptr(), opacity, color, *addresses(*shared))
        return d_mean, d_rotation, *shared

    def _record(self, frames: int, gaussians: int, colors: int) -> _Steps:
        """Record every launch; this compiles the kernels where they are not yet."""
        total, vec = frames * gaussians, {2: wp.vec2, 3: wp.vec3}
        columns, rows = -(-self.view.width // TILE_PX), -(-self.view.height // TILE_PX)
        tiles, window = frames * columns * rows, (self.view.width, self.view.height, columns, rows)
        device, grid = wp.device_from_torch(self.device), (gaussians, columns, rows)

        def step(kernel: wp.Kernel, threads: int, numbers: Sequence[Any], *arrays: Any, block: int = BLOCK) -> RecordedLaunch:
            return RecordedLaunch(kernel, threads, numbers, arrays, device, block_dim=block)

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
            composite=step(composite_tiles, _in_blocks(tiles * PARTS * WARP), [tiles, *window], *pixels),
            backward=step(composite_tiles_backward, _in_blocks(tiles * PARTS * WARP), [tiles, *window], *backward),
            backward_by_pair=step(composite_pairs_backward, _in_blocks(tiles * WARP), [tiles, *window], *backward),
            sum_pairs=step(sum_pairs, total, grid, *boxes, (FLOAT, SPLAT), INT, KEY, vec10, vec10),
            project_backward=step(project_backward, total, [self.view, gaussians], *returned),
            sum_frames=step(sum_frames, gaussians, [frames, gaussians, colors], wp.vec3, *row(GRADIENT, 1, 3), wp.vec3, FLOAT, wp.vec3),
        )


def _boxes(box: torch.Tensor) -> tuple[int, int]:
    """Addresses of the boxes of tiles and of their counts."""
    return box.data_ptr(), box.data_ptr() + BYTES * (len(box) // 5) * 4


def _background(scene: Scene) -> tuple[int, int]:
    """Address and number of pixels."""
    return scene.background.data_ptr(), len(scene.background)


def _in_blocks(threads: int) -> int:
    return -(-threads // BLOCK) * BLOCK
