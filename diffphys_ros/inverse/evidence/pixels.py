"""How far the rendered frames are from the video."""

from __future__ import annotations

import numpy as np
import torch
from scipy.ndimage import binary_erosion

from ...inpaint import scene_behind
from ...metrics.image import depth_loss, image_loss
from ...render import window_around
from ...types import Clip, object_mask
from ..carried import CarriedGaussians
from ..prepared import Prepared
from .told import Evidence, Moved, Told

MARGIN_PX = 8  # of the rendered window around the object
BACKGROUND_FRAMES = 15  # at least, where there are as many, that are asked what the scene behind the object looks like
TEXTURE_PX = 2.0  # displacement at which textured images of the object have nothing in common any more
EDGE_PX = 2  # pixels this near to the mask's border are left out of the depth term
GROSS = 3.0  # depth errors above this multiple of the rms motion are left out
_ACROSS = np.array([[[0, 1, 0], [1, 1, 1], [0, 1, 0]]], bool)  # neighbours of a pixel within its frame


def static_background(clip: Clip) -> np.ndarray:
    """The scene without the object, uint8 (H, W, 3): the median over the frames that show it, the nearest such pixel where
    none does."""
    assert clip.labels is not None
    some = slice(None, None, max(1, len(clip) // BACKGROUND_FRAMES))
    return scene_behind(clip.frames[some], clip.labels[some] == 0)


def pixel_evidence(told: Told) -> Evidence | None:
    """Misfits of colours and, where the clip has it, depth; None without Gaussians, or where neither weighs anything."""
    w = told.weights
    if told.shown is None or not (w.image_weight > 0 or w.depth_weight > 0):
        return None
    with_depth = w.depth_weight > 0 and told.prepared.tracks.has_depth
    term = ImageTerm(told.prepared, told.shown, every=told.every, ssim_weight=w.ssim_weight, with_depth=with_depth)
    term.calibrate(told.x_rest)

    def misfit(moved: Moved) -> dict[str, torch.Tensor]:
        image, depth = term(moved.x, moved.F, told.target.mean_square)
        return {"image": w.image_weight * image.double(), "depth": w.depth_weight * depth.double()}

    return misfit


class ImageTerm:
    """Masked L2 + SSIM (paper A.13) and depth misfit over chosen frames, both in the unit of the track term: half a mean
    squared misfit over the mean squared motion.

    An image misfit becomes one of motion by the share of the frozen first frame's misfit that it has: near the optimum it grows
    with the square of the displacement and is as large as the frozen frame's where the texture no longer overlaps, TEXTURE_PX away.
    """

    def __init__(self, prepared: Prepared, renderer: CarriedGaussians, *, every: int, ssim_weight: float, with_depth: bool):
        clip = prepared.clip
        assert clip.labels is not None
        self.renderer, self.ssim_weight = renderer, ssim_weight
        chosen = np.arange(every, len(clip), every)
        self.frames = chosen[clip.seen[chosen]]
        self.window = window_around(object_mask(clip.labels), MARGIN_PX)
        left, top, right, bottom = self.window
        crop = (slice(top, bottom), slice(left, right))
        device = renderer.mean.device
        self.observed = torch.as_tensor(clip.frames[self.frames][:, *crop], device=device).float() / 255
        self.mask = torch.as_tensor(object_mask(clip.labels[self.frames])[:, *crop], device=device)
        self.interior = torch.as_tensor(binary_erosion(object_mask(clip.labels[self.frames]), _ACROSS, EDGE_PX)[:, *crop], device=device)
        self.depth = None
        if with_depth and clip.depth is not None:
            self.depth = torch.as_tensor(clip.depth[self.frames][:, *crop], device=device).float()
        self.frozen = 1.0
        self.overlap = min(1.0, TEXTURE_PX / _rms_motion_px(prepared)) ** 2

    def calibrate(self, x0: torch.Tensor) -> None:
        """Measure the image misfit of the frozen first frame: particles (P, 3) that never move."""
        still = x0.detach()[None].expand(len(self.frames), *x0.shape)
        unit = torch.eye(3, dtype=x0.dtype, device=x0.device).expand(*still.shape[:2], 3, 3)
        with torch.no_grad():
            self.frozen = max(float(self._image(*self._rendered(still, x0, unit)[:1])), 1e-12)

    def __call__(self, x: torch.Tensor, F: torch.Tensor, mean_square: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Image and depth term of particles x (T, P, 3) [m], F (T, P, 3, 3) since frame 0, body frame; `mean_square` of the observed
        motion [m^2]. The latter is 0 where the clip has no depth."""
        image, _, depth = self._rendered(x[self.frames], x[0], F[self.frames])
        return 0.5 * self.overlap * self._image(image) / self.frozen, self._depth(depth, mean_square)

    def _rendered(self, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return self.renderer.render(x, x0, F, self.window)

    def _image(self, image: torch.Tensor) -> torch.Tensor:
        return image_loss(image, self.observed, self.mask, ssim_weight=self.ssim_weight)

    def _depth(self, depth: torch.Tensor, mean_square: float) -> torch.Tensor:
        """Gross errors are left out: there the pixel shows something else than the mask says."""
        if self.depth is None:
            return torch.zeros((), device=depth.device)
        near = (depth.detach() - self.depth).abs() < GROSS * mean_square**0.5
        return 0.5 * depth_loss(depth, self.depth, self.interior & near) / mean_square


def _rms_motion_px(prepared: Prepared) -> float:
    tracks = prepared.tracks
    moved = (tracks.pixels - tracks.pixels[:1])[tracks.valid]
    return max(float(np.sqrt((moved**2).sum(-1).mean())), 1e-3)
