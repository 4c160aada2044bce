"""The chain of launches on the CPU: project, list by tile with a radix sort, composite; and back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
import warp as wp

from .composite import Layout, composite, composite_backward
from .project import project, project_backward, sum_frames
from .scene import Rendered, Scene, Tensors
from .tiles import sort_into_tiles
from .view import View

TILE_PX = 4  # short lists pay on a single core


class _Kept(NamedTuple):
    """Projected Gaussians, flat over frame and Gaussian, and their tiles."""

    centre: torch.Tensor
    conic: torch.Tensor
    reach: torch.Tensor
    depth: torch.Tensor
    opacity: torch.Tensor
    color: torch.Tensor
    touched: torch.Tensor  # tiles, by Gaussian
    start: torch.Tensor  # as in Tiles
    owner: torch.Tensor


class CpuChain:
    """One thread of the processor walks over Gaussians and pixels in order: results are reproducible to the bit."""

    def __init__(self, view: View) -> None:
        self.view = view

    def forward(self, scene: Scene) -> Rendered:
        """Image, alpha and depth."""
        kept = self._project(scene)
        shape = (scene.frames, self.view.height, self.view.width)
        images = tuple(torch.empty(*shape, *n) for n in ((3,), (), ()))
        _launch(composite, self._threads(kept), [self._layout(), *self._lists(kept, scene), *_pixels(images)])
        return Rendered(images, kept)

    def backward(self, scene: Scene, rendered: Rendered, cotangents: Sequence[torch.Tensor | None]) -> Tensors:
        """Gradients of mean, rotation, scale, opacity, color from those of image, alpha, depth (None: zero)."""
        kept = _Kept(*rendered.kept)
        centre, conic, depth, peak, paint = (torch.zeros(scene.total, *n) for n in ((2,), (3,), (), (), (3,)))
        seen = [torch.zeros_like(i) if c is None else c for i, c in zip(rendered.images, cotangents, strict=True)]
        arrays = [*self._lists(kept, scene), *_pixels(rendered.images), *_pixels(seen), centre, conic, depth, peak, paint]
        _launch(composite_backward, self._threads(kept), [self._layout(), *arrays])
        d_mean, d_rotation, each_scale = torch.empty_like(scene.mean), torch.empty_like(scene.rotation), torch.empty_like(scene.mean)
        moved = [_flat(scene.mean), _flat(scene.rotation), scene.scale, kept.conic, kept.touched, centre, conic, depth]
        outputs = [_flat(d_mean), _flat(d_rotation), _flat(each_scale)]
        _launch(project_backward, scene.total, [self.view, scene.gaussians, *moved, *outputs])
        shared = tuple(torch.empty_like(t) for t in (scene.scale, scene.opacity, scene.color))
        _launch(sum_frames, scene.gaussians, [scene.frames, *scene.counts, _flat(each_scale), peak, paint, *shared])
        return d_mean, d_rotation, *shared

    def _project(self, scene: Scene) -> _Kept:
        centre, conic, depth, reach, peak, paint = (torch.empty(scene.total, *n) for n in ((2,), (3,), (), (), (), (3,)))
        box, count = (torch.empty(scene.total, *n, dtype=torch.int32) for n in ((4,), ()))
        inputs = [self.view, TILE_PX, *scene.counts, _flat(scene.mean), _flat(scene.rotation), scene.scale, scene.opacity, scene.color]
        _launch(project, scene.total, [*inputs, centre, conic, depth, reach, peak, paint, box, count, None])
        arrays: list[Any] = [wp.from_torch(box, dtype=wp.vec4i), wp.from_torch(count), wp.from_torch(depth)]
        tiles = sort_into_tiles(*arrays, gaussians=scene.gaussians, columns=self._columns, rows=self._rows)
        return _Kept(centre, conic, reach, depth, peak, paint, count, wp.to_torch(tiles.start), wp.to_torch(tiles.owner))

    @property
    def _columns(self) -> int:
        return -(-self.view.width // TILE_PX)

    @property
    def _rows(self) -> int:
        return -(-self.view.height // TILE_PX)

    def _layout(self) -> Layout:
        layout = Layout()
        layout.width, layout.height = self.view.width, self.view.height
        layout.side, layout.columns, layout.rows = TILE_PX, self._columns, self._rows
        return layout

    def _threads(self, kept: _Kept) -> int:
        return (len(kept.start) - 1) * TILE_PX**2

    def _lists(self, kept: _Kept, scene: Scene) -> list[Any]:
        return [kept.start, kept.owner, *kept[:6], scene.background]


def _pixels(images: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    image, alpha, depth = (t.contiguous() for t in images)
    return [image.view(-1, 3), alpha.view(-1), depth.view(-1)]


def _flat(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.view(-1, tensor.shape[-1])


def _launch(kernel: wp.Kernel, threads: int, arguments: Sequence[Any]) -> None:
    plain = [a.detach() if isinstance(a, torch.Tensor) else a for a in arguments]
    wp.launch(kernel, threads, plain, device="cpu")
