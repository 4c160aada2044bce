"""The door between torch and the kernels: a differentiable renderer of 3D Gaussians."""

from __future__ import annotations

from typing import Any

import torch
import warp as wp

from ..errors import InputError
from ..types import Camera
from .cpu import CpuChain
from .cuda import CudaChain
from .harmonics import DEGREES, shade
from .scene import Rendered, Scene
from .view import Window, full_window, make_view

Chain = CpuChain | CudaChain


class Rasterizer:
    """Renders 3D Gaussians into one camera.

    EWA splatting as in Kerbl et al. 2023: image covariances are dilated by 0.3 px^2 (without compensating the
    opacity), contributions below 1/255 are left out, compositing stops before the transmittance falls to 1e-4.
    Everything is float32 and lives on `device`; gradients reach means, rotations, scales, opacities, colours and
    background. Results are reproducible to the bit on the CPU, and on CUDA where torch is asked for deterministic
    algorithms (torch.use_deterministic_algorithms): by default the sums of its backward pass are not ordered.
    """

    def __init__(self, camera: Camera, device: str = "cpu") -> None:
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # no banner, no compile log
        wp.init()
        self.camera = camera
        self.device = torch.empty(0, device=device).device  # with its number
        self._black = torch.zeros(1, 3, device=self.device)
        self._chains: dict[Window, Chain] = {}

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
        opacity (G,) 0..1; color (G, 3), or (G, K, 3) with K = 1, 4, 9, 16 coefficients of spherical harmonics of degree 0..3
        over the direction of view (Kerbl et al. 2023: 0.5 is added, what is below 0 is cut); background (3,) or (H, W, 3),
        black where left out. `window` (left, top, right, bottom) [px] renders that part of the image only: h, w are its
        size. Raises InputError for wrong shapes.
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
        _check(self.camera, mean, rotation, scale, opacity, color, background)
        mean, rotation, scale, opacity, color = map(self._own, (mean, rotation, scale, opacity, color))
        if color.ndim == 3:
            color = shade(mean, color, tuple(self.camera.position.tolist()))
        behind = self._black if background is None else _crop(self._own(background), window).reshape(-1, 3)
        return _Render.apply(mean, rotation, scale, opacity, color, behind, self._chain(window))

    def _chain(self, window: Window) -> Chain:
        if window not in self._chains:
            view = make_view(self.camera, window)
            self._chains[window] = CudaChain(view, self.device) if self.device.type == "cuda" else CpuChain(view)
        return self._chains[window]

    def _own(self, tensor: torch.Tensor) -> torch.Tensor:
        return tensor.to(self.device, torch.float32).contiguous()


def _check(
    camera: Camera,
    mean: torch.Tensor,
    rotation: torch.Tensor,
    scale: torch.Tensor,
    opacity: torch.Tensor,
    color: torch.Tensor,
    background: torch.Tensor | None,
) -> None:
    frames, count = mean.shape[:2]
    wanted = {"mean": (frames, count, 3), "rotation": (frames, count, 4), "scale": (count, 3), "opacity": (count,), "color": (count, 3)}
    if color.ndim == 3:
        wanted["color"] = (count, color.shape[1] if color.shape[1] in DEGREES else 16, 3)
    for (name, shape), tensor in zip(wanted.items(), (mean, rotation, scale, opacity, color), strict=True):
        if tuple(tensor.shape) != shape or not count:
            raise InputError(f"Gaussians: {name} has shape {tuple(tensor.shape)}, must be {shape} with at least one Gaussian")
    still = camera.height, camera.width, 3
    if background is not None and tuple(background.shape) not in {(3,), still, (frames, *still)}:
        raise InputError(f"background: has shape {tuple(background.shape)}, must be (3,), {still} or {(frames, *still)}")


def _crop(background: torch.Tensor, window: Window) -> torch.Tensor:
    left, top, right, bottom = window
    return background if background.ndim == 1 else background[..., top:bottom, left:right, :]


class _Render(torch.autograd.Function):
    """Image, alpha and depth from Gaussians; the one place where torch's derivatives meet the kernels'."""

    @staticmethod
    def forward(ctx: Any, mean, rotation, scale, opacity, color, background, chain: Chain):  # type: ignore[no-untyped-def]
        scene = Scene(*(t.detach() for t in (mean, rotation, scale, opacity, color, background)))
        rendered = chain.forward(scene)
        ctx.set_materialize_grads(False)
        ctx.chain = chain
        ctx.save_for_backward(mean, rotation, scale, opacity, color, background, *rendered.images, *rendered.kept)
        return rendered.images

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *cotangents):  # type: ignore[no-untyped-def]
        saved = tuple(t.detach() for t in ctx.saved_tensors)
        scene, rendered, behind = Scene(*saved[:6]), Rendered(saved[6:9], saved[9:]), None
        gradients = ctx.chain.backward(scene, rendered, cotangents)
        if ctx.needs_input_grad[5] and cotangents[0] is not None:
            passed = (1 - rendered.images[1])[..., None] * cotangents[0]
            behind = passed.view(-1, *scene.background.shape).sum(0)
        return *gradients, behind, None
