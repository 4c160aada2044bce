"""Gaussians of frame 0 against many frames, carried by the recovered motion; material and force stay as they are."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import torch

from ..config import Settings
from ..losses import foreground, psnr_masked
from ..particles import Binding, bind, deform_splats
from ..render import Rasterizer
from ..splats import Motion, View, fit_views
from ..types import Clip, Recovery, Splats
from .answer import nearness, shown_frames
from .clock import Clock
from .images import CHUNK, static_background
from .prepare import Prepared
from .progress import Progress, told
from .solve import pick_device

LEAST_STEPS = 40
PASSES = 2  # over the frames, at least


def refine_gaussians(
    prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings, *, clock: Clock | None = None
) -> Generator[Progress, None, tuple[Splats, Recovery]]:
    """Gaussians fitted on to splats.refine_frames frames of the clip, and the recovery with frames and image metrics of these; all
    else in it stays. They are kept only where the frames that were not fitted are nearer to the video than before (all frames, where
    none was left out). Yields news."""
    clip, device = prepared.clip, pick_device(settings)
    if clock is not None and not clock.allows_refinement():
        said = f"Gaussians of frame 0 kept: the time budget of {clock.limit_s:.0f} s is spent"
        yield Progress("splats", text=said)
        return splats, replace(recovery, notes=(*recovery.notes, said), metrics=recovery.metrics | {"stopped_by_budget": True})
    chosen = frames_to_fit(clip, settings.splats.refine_frames)
    if recovery.frames is None or not len(chosen):
        return splats, recovery
    assert clip.labels is not None
    carried, background = CarriedGaussians(recovery, device), static_background(clip)
    views = [View(clip.frames[k], clip.camera, clip.labels[k], background, carried.motion(int(k))) for k in chosen]
    steps = max(LEAST_STEPS, PASSES * len(views))
    refined = yield from told("splats", fit_views(views, splats, settings, device, iterations=steps, near=True))
    shown, others = carried.frames(refined, clip, background), unfitted_frames(clip, chosen)
    judged = others if len(others) else shown_frames(clip)
    before, after = (mean_psnr(clip, frames, judged) for frames in (recovery.frames, shown))
    if after <= before:
        yield Progress("splats", text=f"Gaussians of frame 0 kept: fitted to {len(chosen)} frames they show the others no better")
        return splats, recovery
    yield Progress("splats", text=f"Gaussians fitted to {len(chosen)} frames: PSNR {before:.1f} to {after:.1f} dB in the others", artefact=refined)
    found: dict[str, object] = {"gaussians_fitted_frames": chosen.tolist(), "psnr_masked_before_refinement": recovery.metrics["psnr_masked"]}
    if len(others):
        found["psnr_masked_unfitted_frames"] = after
    return refined, replace(recovery, frames=shown, metrics=recovery.metrics | nearness(clip, shown) | found)


def frames_to_fit(clip: Clip, count: int) -> np.ndarray:
    """At most `count` frames, evenly spaced among those that were received and show the object; from frame 0 on."""
    shown = shown_frames(clip)
    return shown[np.unique(np.linspace(0, len(shown) - 1, min(count, len(shown))).round().astype(int))]


def unfitted_frames(clip: Clip, fitted: np.ndarray) -> np.ndarray:
    """The other frames that were received and show the object."""
    return np.setdiff1d(shown_frames(clip), fitted)


def mean_psnr(clip: Clip, frames: np.ndarray, chosen: np.ndarray) -> float:
    """Masked PSNR [dB], mean over the chosen frames."""
    assert clip.labels is not None
    return float(np.mean([psnr_masked(frames[k], clip.frames[k], foreground(clip.labels[k])) for k in chosen]))


class CarriedGaussians:
    """How Gaussians ride on the recovered particles (paper A.11), world frame."""

    def __init__(self, recovery: Recovery, device: str) -> None:
        self.x0 = recovery.trajectory[0].astype(float)
        self.x = torch.as_tensor(recovery.trajectory, dtype=torch.float32, device=device)
        self._bound: tuple[torch.Tensor, Binding] | None = None

    def motion(self, frame: int) -> Motion:
        """Of means in frame 0 to a frame."""

        def move(mean: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            still = mean.new_tensor([1.0, 0, 0, 0]).expand(len(mean), 4)
            there, turn = deform_splats(self._binding(mean), mean, still, self.x[[frame]], self.x[0], None)
            return there[0] - mean, turn[0]

        return move

    def frames(self, splats: Splats, clip: Clip, background: np.ndarray) -> np.ndarray:
        """The clip as the Gaussians show it, uint8 (T, H, W, 3)."""
        device = self.x.device
        mean, rotation, scale, opacity, color = (torch.as_tensor(a, dtype=torch.float32, device=device) for a in vars(splats).values())
        rasterizer, behind = Rasterizer(clip.camera, str(device)), torch.as_tensor(background, device=device).float() / 255
        shown = []
        with torch.no_grad():
            for x in self.x.split(CHUNK):
                there = deform_splats(self._binding(mean), mean, rotation, x, self.x[0], None)
                image = rasterizer.render_frames(*there, scale, opacity, color, behind)[0]
                shown.append((image.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy())
        return np.concatenate(shown)

    def _binding(self, mean: torch.Tensor) -> Binding:
        if self._bound is None or not torch.equal(self._bound[0], mean):
            self._bound = mean.clone(), bind(mean.double().cpu().numpy(), self.x0)
        return self._bound[1]
