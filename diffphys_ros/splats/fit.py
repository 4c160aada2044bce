"""Static Gaussians of frame 0 (paper section 3.2): back-projected from depth, then fitted to the image."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
import torch

from ..config import Settings
from ..errors import InputError
from ..losses import foreground
from ..render import Rasterizer, Window, window_around
from ..types import IGNORE, Camera, Splats
from .density import prune_and_split
from .discs import Discs, discs_of, gaussians, leaning, to_splats
from .ply import canonical
from .primitives import ShrinkingAdam
from .seed import BLOCKS_DB, MOST, count_blocks, gather_blocks, surface_at
from .view import picture_loss, without

MARGIN_PX = 8  # of the rendered window around the object
FIRST_SHARE = 0.75  # of the count that the fit starts with; splitting adds the rest
SPLIT_AT = (0.25, 0.5)  # shares of the iterations after which discs are pruned and split
RATES = {"pixel": 0.2, "log_scale": 0.06, "angle": 0.05, "logit": 0.1, "color": 0.005}  # Adam steps [px, -, rad, -, -]
LEAN = 0.06  # slope of depth across the line of sight, in a direction that is new in every iteration
LAST_RATE = 0.1  # of the steps at the end over those at the start


@dataclass(frozen=True)
class _Target:
    """What the Gaussians must look like, cropped to the window."""

    rasterizer: Rasterizer
    window: Window
    image: torch.Tensor  # 0..1, (h, w, 3)
    mask: torch.Tensor  # the object, bool, (h, w)
    counted: torch.Tensor  # not ignored, bool, (h, w)
    depth: torch.Tensor  # [m], (h, w)
    depth_known: torch.Tensor  # on the object, bool, (h, w)
    around: torch.Tensor  # the picture without the object: every pixel of it takes the nearest other, full image, (H, W, 3)
    ssim_weight: float

    def loss(self, image: torch.Tensor, alpha: torch.Tensor) -> torch.Tensor:
        return picture_loss(image, alpha, self.image, self.mask, self.counted, ssim_weight=self.ssim_weight)

    def under(self, discs: Discs, values: torch.Tensor) -> torch.Tensor:
        """Sum of values (h, w) over the pixels that each disc fills (G,): the gradient of the image with respect to a
        colour is how much of each pixel the disc fills."""
        mean, rotation, scale, opacity, color = (t.detach() for t in gaussians(discs, self.rasterizer.camera))
        color.requires_grad_()
        image = self.rasterizer.render(mean, rotation, scale, opacity, color, window=self.window)[0]
        return torch.autograd.grad((image[..., 0] * values).sum(), color)[0][:, 0]

    def render(self, discs: Discs) -> tuple[torch.Tensor, ...]:
        return self.rasterizer.render(*gaussians(discs, self.rasterizer.camera), self.around, window=self.window)


def fit_splats(
    image0: np.ndarray, labels0: np.ndarray, depth0: np.ndarray, camera: Camera, settings: Settings, device: str = "cpu"
) -> Generator[tuple[int, int, float], None, Splats]:
    """Gaussians of the object in frame 0; yields (iteration, iterations, loss) and returns canonical Splats.

    image0 uint8 (H, W, 3), labels0 (H, W) (255 is neither fitted nor painted), depth0 (H, W) [m, 0 where unknown].
    Raises InputError where the mask is empty or no masked pixel has a depth.
    """
    mask = foreground(labels0)
    if not mask.any():
        raise InputError("mask: frame 0 shows no object; give scene.first_mask")
    image, count = image0.astype(np.float32) / 255, settings.splats.max_count
    if not count:
        count = round(count_blocks(image, mask, BLOCKS_DB, int(FIRST_SHARE * MOST)) / FIRST_SHARE)
    target = _target(image, labels0, depth0, camera, settings, device)
    blocks = gather_blocks(image, mask, max(int(FIRST_SHARE * count), 1))
    discs = discs_of(blocks, surface_at(blocks.centre, depth0, mask, camera), device)
    discs = yield from _optimise(discs, target, settings.splats.iterations, count)
    return canonical(to_splats(discs, camera))


def _target(image: np.ndarray, labels0: np.ndarray, depth0: np.ndarray, camera: Camera, settings: Settings, device: str) -> _Target:
    mask = foreground(labels0)
    window = left, top, right, bottom = window_around(mask, MARGIN_PX)

    def crop(array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(np.ascontiguousarray(array[top:bottom, left:right]), device=device)

    known = mask & np.isfinite(depth0) & (depth0 > 0)
    return _Target(
        rasterizer=Rasterizer(camera, device),
        window=window,
        image=crop(image),
        mask=crop(mask),
        counted=crop(labels0 != IGNORE),
        depth=crop(np.where(known, depth0, 0).astype(np.float32)),
        depth_known=crop(known),
        around=torch.as_tensor(without(image, labels0 > 0), device=device),
        ssim_weight=settings.fit.ssim_weight,
    )


def _optimise(discs: Discs, target: _Target, iterations: int, count: int) -> Generator[tuple[int, int, float], None, Discs]:
    """Adam with steps that shrink to LAST_RATE, pruning and splitting on the way.

    Discs overlap, and the nearer one covers the other. Fitted in one order alone, they would lean on it: when the surface turns
    by a few degrees, every disc covers its neighbour on one side and the texture seems to shift by half a pixel. So each
    iteration sees them in the order of a surface that leans some other way.
    """
    discs, rounds = discs.leaves(), {round(share * iterations) for share in SPLIT_AT}
    descent, generator = ShrinkingAdam(RATES, last=LAST_RATE, iterations=iterations), torch.Generator().manual_seed(0)
    descent.begin(discs)
    for iteration in range(iterations):
        if iteration in rounds:
            discs = prune_and_split(discs, *_contributions(discs, target), count)
            discs = _onto_depth(discs, target).leaves()
            descent.begin(discs, iteration)
        towards = 2 * torch.pi * float(torch.rand((), generator=generator))
        image, alpha, _ = target.render(leaning(discs, target.rasterizer.camera, LEAN, towards))
        loss = target.loss(image, alpha)
        descent.step(loss)
        yield iteration + 1, iterations, float(loss.detach())
    return discs


def _contributions(discs: Discs, target: _Target) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared residual under each disc and pixels that it fills (G,)."""
    with torch.no_grad():
        residual = (target.image - target.render(discs)[0]).square().sum(-1)
    return target.under(discs, residual * target.mask), target.under(discs, target.mask.float())


def _onto_depth(discs: Discs, target: _Target) -> Discs:
    """Move each disc along its line of sight by what the picture's depth lacks there: where discs overlap, the nearer one
    shows, so that discs on the surface would look nearer than the surface."""
    with torch.no_grad():
        lacking = torch.where(target.depth_known, target.depth - target.render(discs)[2], 0.0)
    share = target.under(discs, target.depth_known.float())
    return replace(discs, depth=discs.depth + target.under(discs, lacking) / share.clamp_min(1e-3))
