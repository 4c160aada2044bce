"""How far the rendered frames are from the video."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import binary_dilation, binary_erosion

from ...inpaint import scene_behind
from ...metrics.image import coarser, coarser_mask, depth_loss, image_loss, known_depth
from ...render import window_around
from ...types import IGNORE, Clip, object_mask
from ..carried import CarriedGaussians
from ..prepared import Prepared
from .recomputed import Part, recomputed
from .told import Evidence, Moved, Told

MARGIN_PX = 8  # of the rendered window around the object
BACKGROUND_FRAMES = 15  # at least, where there are as many, that are asked what the scene behind the object looks like
TEXTURE_PX = 2.0  # displacement at which textured images of the object have nothing in common any more
EDGE_PX = 2  # pixels this near to the mask's border are left out of the depth term
GROSS = 3.0  # depth errors above this multiple of the rms motion are left out
_ACROSS = np.array([[[0, 1, 0], [1, 1, 1], [0, 1, 0]]], bool)  # neighbours of a pixel within its frame


def static_background(clip: Clip, *, edge_px: int = 0) -> np.ndarray:
    """The scene without the object, uint8 (H, W, 3): the median over the frames that show it, the nearest such pixel where
    none does. With edge_px, what BACKGROUND_FRAMES do not show more than so far away from the object is asked of all frames, then of those that
    show it beside the object."""
    assert clip.labels is not None
    some = slice(None, None, max(1, len(clip) // BACKGROUND_FRAMES))
    frames, shown = clip.frames, clip.labels == 0
    if not edge_px:
        return scene_behind(frames[some], shown[some])
    clear = ~binary_dilation(~shown, _ACROSS, edge_px)
    scene = scene_behind(frames[some], clear[some] if clear[some].any() else shown[some])
    known = clear[some].any(0)
    for also in (clear, shown):
        lacking = also.any(0) & ~known
        scene = np.where(lacking[..., None], scene_behind(frames, also & lacking), scene)
        known |= lacking
    return scene


def pixel_evidence(told: Told) -> Evidence | None:
    """Misfits of colours and, where the clip has it, depth; None without Gaussians, or where neither weighs anything."""
    w = told.weights
    if told.shown is None or not (w.image_weight > 0 or w.depth_weight > 0):
        return None
    with_depth = w.depth_weight > 0 and told.prepared.tracks.has_depth
    term = ImageTerm(told.prepared, told.shown, every=told.every, ssim_weight=w.ssim_weight, with_depth=with_depth, margin_px=w.mask_margin_px, published=w.published)
    term.calibrate(told.x_rest)
    return PixelEvidence(term, w.image_weight, w.depth_weight, told.target.mean_square)


@dataclass(frozen=True)
class PixelEvidence:
    """The two misfits of pictures, weighted."""

    term: ImageTerm
    image_weight: float
    depth_weight: float
    mean_square: float  # of the observed motion [m^2]

    def __call__(self, moved: Moved) -> dict[str, torch.Tensor]:
        """Of a whole clip."""
        image, depth = self.term(moved.x, moved.F, self.mean_square)
        return {"image": self.image_weight * image.double(), "depth": self.depth_weight * depth.double()}


class _Misfits(NamedTuple):
    """Of some frames: the mean misfit of an object's pixel and of a depth [m^2], and over how many of them."""

    image: torch.Tensor
    pixels: torch.Tensor
    depth: torch.Tensor
    measured: torch.Tensor


class ImageTerm:
    """Masked L2 + SSIM (paper A.13) and depth misfit over chosen frames, both in the unit of the track term: half a mean
    squared misfit over the mean squared motion.

    An image misfit becomes one of motion by the share of the frozen first frame's misfit that it has: near the optimum it grows
    with the square of the displacement and is as large as the frozen frame's where the texture no longer overlaps, TEXTURE_PX away.
    Where nothing but pictures counts (`published`) it stays the share of the frozen frame's misfit, whatever the size of a pixel, and the
    pixels are those of the region that moves in any frame (paper 4.1): what swings out of the object's mask would else cost nothing there.
    """

    def __init__(self, prepared: Prepared, renderer: CarriedGaussians, *, every: int, ssim_weight: float, with_depth: bool, margin_px: int = 0, published: bool = False):
        clip = prepared.clip
        assert clip.labels is not None
        self.renderer, self.ssim_weight = renderer, ssim_weight
        chosen = np.arange(every, len(clip), every)
        self.frames = chosen[clip.seen[chosen]]
        self.window = window_around(object_mask(clip.labels), max(MARGIN_PX, margin_px + 1))
        left, top, right, bottom = self.window
        crop = (self.frames, slice(top, bottom), slice(left, right))  # a copy of these pixels alone
        device, mask = renderer.mean.device, object_mask(clip.labels[crop])
        known = clip.labels[crop] != IGNORE
        region = np.broadcast_to(mask.any(0), mask.shape) if published else mask
        counted = binary_dilation(region, _ACROSS, margin_px) & known if margin_px else region & known
        self.observed = torch.as_tensor(clip.frames[crop], device=device)  # 0..255
        self.mask = torch.as_tensor(counted, device=device)
        self.depth = self.measured = None
        if with_depth and clip.depth is not None:
            interior = torch.as_tensor(binary_erosion(mask, _ACROSS, EDGE_PX), device=device)
            self.depth = torch.as_tensor(clip.depth[crop], device=device).float()
            self.measured = known_depth(self.depth, interior)
        self.frozen = 1.0
        self.overlap = 1.0 if published else min(1.0, TEXTURE_PX / _rms_motion_px(prepared)) ** 2

    def calibrate(self, x0: torch.Tensor) -> None:
        """Measure the image misfit of the frozen first frame: particles (P, 3) that never move."""
        still = x0.detach()[None].expand(len(self.frames), *x0.shape)
        unit = torch.eye(3, dtype=x0.dtype, device=x0.device).expand(*still.shape[:2], 3, 3)
        with torch.no_grad():
            self.frozen = max(float(self._misfits(still, x0, unit, 1.0).image), 1e-12)

    def __call__(self, x: torch.Tensor, F: torch.Tensor, mean_square: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Image and depth term of particles x (T, P, 3) [m], F (T, P, 3, 3) since frame 0, body frame; `mean_square` of the observed
        motion [m^2]. The latter is 0 where the clip has no depth."""
        found = self._misfits(x[self.frames], x[0], F[self.frames], mean_square)
        return 0.5 * self.overlap * found.image / self.frozen, 0.5 * found.depth / mean_square

    def of_frames(self, numbers: np.ndarray, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor, *, block_px: int = 1) -> torch.Tensor:
        """The image term of neighbouring frames `numbers` (S,) alone, with particles x (S, P, 3) and F (S, P, 3, 3) there; 0 where none of them
        is looked at. Pictures are compared as means over blocks of block_px x block_px pixels."""
        chosen, seen = np.flatnonzero(np.isin(self.frames, numbers)), np.isin(numbers, self.frames)
        if not len(chosen):
            return 0.0 * x.sum()
        found = self._of(slice(int(chosen[0]), int(chosen[-1]) + 1), x[seen], x0, F[seen], 1.0, block_px)
        return 0.5 * self.overlap * found.image / self.frozen

    def _misfits(self, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor, mean_square: float) -> _Misfits:
        """Of particles x (S, P, 3), F (S, P, 3, 3) in the chosen frames, as many of them at a time as memory is meant for."""
        spans = self.renderer.spans(len(x))
        parts: list[Part] = [partial(self._of, span, mean_square=mean_square) for span in spans]
        if len(parts) > 1:
            parts = [partial(recomputed, part) for part in parts]
        image, pixels, depth, measured = map(torch.stack, zip(*(part(x[span], x0, F[span]) for part, span in zip(parts, spans, strict=True)), strict=True))
        return _Misfits(_mean(image, pixels), pixels.sum(), _mean(depth, measured), measured.sum())

    def _of(self, span: slice, x: torch.Tensor, x0: torch.Tensor, F: torch.Tensor, mean_square: float, block_px: int = 1) -> _Misfits:
        """Of a few of the chosen frames. Gross errors of depth are left out: there the pixel shows something else than the mask says."""
        image, _, depth = self.renderer.render(x, x0, F, self.window)
        mask, observed = self.mask[span], self.observed[span].float() / 255
        if block_px > 1:
            shown, seen, counted = coarser(image, block_px), coarser(observed, block_px), coarser_mask(mask, block_px)
        else:
            shown, seen, counted = image, observed, mask
        colours = image_loss(shown, seen, counted, ssim_weight=self.ssim_weight)
        if self.depth is None or self.measured is None:
            return _Misfits(colours, mask.sum(), *torch.zeros(2, device=depth.device))
        near = (depth.detach() - self.depth[span]).abs() < GROSS * mean_square**0.5
        known = self.measured[span] & near
        return _Misfits(colours, mask.sum(), depth_loss(depth, self.depth[span], known), known.sum())


def _mean(values: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Of means over some each; 0 where there are none."""
    return (values * counts).sum() / counts.sum().clamp_min(1)


def _rms_motion_px(prepared: Prepared) -> float:
    tracks = prepared.tracks
    moved = (tracks.pixels - tracks.pixels[:1])[tracks.valid]
    return max(float(np.sqrt((moved**2).sum(-1).mean())), 1e-3)
