"""The door between torch and the kernels: a differentiable renderer of 3D Gaussians."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp

from ..errors import InputError
from ..types import Camera
from .composite import Layout, composite, composite_backward
from .project import project, project_backward
from .tiles import Tiles, sort_into_tiles
from .view import View, Window, full_window, make_view

TILE_PX = {"cpu": 4, "cuda": 16}  # short lists pay on a single core, full blocks on a GPU


class Rasterizer:
    """Renders 3D Gaussians into one camera.

    EWA splatting as in Kerbl et al. 2023: image covariances are dilated by 0.3 px^2 (without compensating the
    opacity), contributions below 1/255 are left out, compositing stops before the transmittance falls to 1e-4.
    Everything is float32 and lives on `device`; gradients reach means, rotations, scales, opacities, colours and
    background. On the CPU results are reproducible to the bit; on CUDA the sums of the backward pass are not ordered.
    """

    def __init__(self, camera: Camera, device: str = "cpu") -> None:
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # no banner, no compile log
        wp.init()
        self.camera = camera
        self.device = torch.device(device)
        self._views: dict[Window, View] = {}

    def render(
        self,
        mean: torch.Tensor,
        rotation: torch.Tensor,
        scale: torch.Tensor,
        opacity: torch.Tensor,
        color: torch.Tensor,
        background: torch.Tensor | None = None,
        *,
        window: Window | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Image (h, w, 3), alpha (h, w) and expected depth (h, w) [m, 0 where nothing is] of one frame.

        mean (G, 3) [m, world], rotation (G, 4) wxyz of any positive norm, scale (G, 3) [m, standard deviations],
        opacity (G,) 0..1, color (G, 3); background (3,) or (H, W, 3), black where left out. `window` (left, top, right,
        bottom) [px] renders that part of the image only: h, w are its size. Raises InputError for wrong shapes.
        """
        images = self.render_frames(mean[None], rotation[None], scale, opacity, color, background, window=window)
        return images[0][0], images[1][0], images[2][0]

    def render_frames(
        self,
        mean: torch.Tensor,
        rotation: torch.Tensor,
        scale: torch.Tensor,
        opacity: torch.Tensor,
        color: torch.Tensor,
        background: torch.Tensor | None = None,
        *,
        window: Window | None = None,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """As render, for T frames: mean (T, G, 3) and rotation (T, G, 4) move, the rest is shared.

        background may be (T, H, W, 3) too. Gives image (T, h, w, 3), alpha (T, h, w), depth (T, h, w).
        """
        window = window or full_window(self.camera)
        if window not in self._views:
            self._views[window] = make_view(self.camera, window)
        _check(mean, rotation, scale, opacity, color)
        image, alpha, weighted = _Render.apply(*map(self._own, (mean, rotation, scale, opacity, color)), self._views[window])
        depth = torch.where(alpha > 0, weighted / alpha.clamp_min(1e-12), 0.0)
        if background is not None:
            image = image + (1 - alpha)[..., None] * _crop(self._own(background), window)
        return image, alpha, depth

    def _own(self, tensor: torch.Tensor) -> torch.Tensor:
        return tensor.to(self.device, torch.float32).contiguous()


def _check(mean: torch.Tensor, rotation: torch.Tensor, scale: torch.Tensor, opacity: torch.Tensor, color: torch.Tensor) -> None:
    frames, count = mean.shape[:2]
    wanted = {"mean": (frames, count, 3), "rotation": (frames, count, 4), "scale": (count, 3), "opacity": (count,), "color": (count, 3)}
    for (name, shape), tensor in zip(wanted.items(), (mean, rotation, scale, opacity, color), strict=True):
        if tuple(tensor.shape) != shape or not count:
            raise InputError(f"Gaussians: {name} has shape {tuple(tensor.shape)}, must be {shape} with at least one Gaussian")


def _crop(background: torch.Tensor, window: Window) -> torch.Tensor:
    left, top, right, bottom = window
    return background if background.ndim == 1 else background[..., top:bottom, left:right, :]


@dataclass
class _Projected:
    """What the forward pass leaves for the backward pass (flat over frame and Gaussian)."""

    centre: torch.Tensor
    conic: torch.Tensor
    depth: torch.Tensor
    reach: torch.Tensor
    count: torch.Tensor
    tiles: Tiles
    layout: Layout


class _Render(torch.autograd.Function):
    """Image over black, alpha and weighted depth from Gaussians; the one place where torch meets Warp."""

    @staticmethod
    def forward(ctx: Any, mean, rotation, scale, opacity, color, view: View):  # type: ignore[no-untyped-def]
        with _stream(mean.device):
            projected = _project(mean, rotation, scale, opacity, view)
            images = _composite(projected, opacity, color, len(mean))
        ctx.view, ctx.projected = view, projected
        ctx.save_for_backward(mean, rotation, scale, opacity, color, *images)
        return images

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *cotangents):  # type: ignore[no-untyped-def]
        mean, rotation, scale, opacity, color, *images = ctx.saved_tensors
        with _stream(mean.device):
            d_centre, d_conic, d_depth, d_opacity, d_color = _composite_backward(ctx.projected, opacity, color, images, cotangents, mean)
            moved = _project_backward(ctx.projected, mean, rotation, scale, ctx.view, (d_centre, d_conic, d_depth))
        return *moved, d_opacity.view(mean.shape[:2]).sum(0), d_color.view(mean.shape).sum(0), None


def _project(mean: torch.Tensor, rotation: torch.Tensor, scale: torch.Tensor, opacity: torch.Tensor, view: View) -> _Projected:
    gaussians, device, side = mean.shape[1], mean.device, TILE_PX[mean.device.type]
    total = len(mean) * gaussians
    centre, conic, depth, reach = (torch.empty(total, *n, device=device) for n in ((2,), (3,), (), ()))
    box, count = (torch.empty(total, *n, device=device, dtype=torch.int32) for n in ((4,), ()))
    inputs = [view, side, gaussians, _flat(mean), _flat(rotation), scale.detach(), opacity.detach()]
    _launch(project, total, inputs, [centre, conic, depth, reach, box, count], device)
    columns, rows = -(-view.width // side), -(-view.height // side)
    arrays: list[Any] = [wp.from_torch(box, dtype=wp.vec4i), wp.from_torch(count), wp.from_torch(depth)]
    tiles = sort_into_tiles(*arrays, gaussians=gaussians, side=side, columns=columns, rows=rows)
    return _Projected(centre, conic, depth, reach, count, tiles, _layout(view, tiles, gaussians))


def _layout(view: View, tiles: Tiles, gaussians: int) -> Layout:
    layout = Layout()
    layout.width, layout.height, layout.gaussians = view.width, view.height, gaussians
    layout.side, layout.columns, layout.rows = tiles.side, tiles.columns, tiles.rows
    return layout


def _composite(p: _Projected, opacity: torch.Tensor, color: torch.Tensor, frames: int) -> tuple[torch.Tensor, ...]:
    shape = (frames, p.layout.height, p.layout.width)
    images = tuple(torch.empty(*shape, *n, device=color.device) for n in ((3,), (), ()))
    _launch(composite, _threads(p), _lists(p, opacity, color), _pixels(images), color.device)
    return images


def _composite_backward(p: _Projected, opacity, color, images, cotangents, mean) -> tuple[torch.Tensor, ...]:  # type: ignore[no-untyped-def]
    total = len(p.depth)
    outputs = tuple(torch.zeros(total, *n, device=mean.device) for n in ((2,), (3,), (), (), (3,)))
    inputs = [*_lists(p, opacity, color), *_pixels(images), *_pixels(cotangents)]
    _launch(composite_backward, _threads(p), inputs, outputs, mean.device)
    return outputs


def _project_backward(p: _Projected, mean, rotation, scale, view, cotangents) -> tuple[torch.Tensor, ...]:  # type: ignore[no-untyped-def]
    d_mean, d_rotation, d_scale = torch.empty_like(mean), torch.empty_like(rotation), torch.empty_like(mean)
    inputs = [view, mean.shape[1], _flat(mean), _flat(rotation), scale.detach(), p.conic, p.count, *cotangents]
    _launch(project_backward, len(p.depth), inputs, [_flat(d_mean), _flat(d_rotation), _flat(d_scale)], mean.device)
    return d_mean, d_rotation, d_scale.sum(0)


def _lists(p: _Projected, opacity: torch.Tensor, color: torch.Tensor) -> list[Any]:
    return [p.layout, p.tiles.start, p.tiles.owner, p.centre, p.conic, p.reach, p.depth, opacity.detach(), color.detach()]


def _pixels(images: Sequence[torch.Tensor]) -> list[torch.Tensor]:
    image, alpha, weighted_depth = (t.detach().contiguous() for t in images)
    return [image.view(-1, 3), alpha.view(-1), weighted_depth.view(-1)]


def _flat(tensor: torch.Tensor) -> torch.Tensor:
    return tensor.detach().view(-1, tensor.shape[-1])


def _threads(p: _Projected) -> int:
    return (p.tiles.start.shape[0] - 1) * p.layout.side**2


def _launch(kernel: wp.Kernel, threads: int, inputs: Sequence[Any], outputs: Sequence[Any], device: torch.device) -> None:
    wp.launch(kernel, threads, list(inputs), list(outputs), device=wp.device_from_torch(device), block_dim=TILE_PX["cuda"] ** 2)


def _stream(device: torch.device) -> Any:
    """Puts Warp on torch's stream, so that what one writes is there when the other reads."""
    if device.type == "cpu":
        return wp.ScopedDevice("cpu")
    return wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(device)))
