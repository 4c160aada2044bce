"""Gaussians of frame 0 against many frames, carried by the recovered motion; material and force stay as they are."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ..config import Settings
from ..devices import usable
from ..metrics.image import psnr_masked
from ..progress import Progress, told
from ..splats import View, fit_views
from ..types import Clip, Recovery, Splats, object_mask
from .answer import nearness, shown_frames
from .carried import CarriedGaussians
from .clock import Clock
from .evidence.pixels import static_background
from .prepared import Prepared

LEAST_STEPS = 40
PASSES = 2  # over the frames, at least


def refine_gaussians(
    prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings, *, behind: np.ndarray | None = None, clock: Clock | None = None
) -> Generator[Progress, None, tuple[Splats, Recovery]]:
    """Gaussians fitted on to experiment.refine_frames frames of the clip, and the recovery with frames and image metrics of these; all
    else in it stays. They are kept only where the frames that were not fitted are nearer to the video than before (all frames, where
    none was left out). behind uint8 (H, W, 3): the scene without the object, None: it is read from the clip. Yields news."""
    clip, device = prepared.clip, usable(settings.fit.device)
    if clock is not None and not clock.allows_refinement():
        said = f"Gaussians of frame 0 kept: the time budget of {clock.limit_s:.0f} s is spent"
        yield Progress("splats", text=said)
        return splats, replace(recovery, notes=(*recovery.notes, said), metrics=recovery.metrics | {"stopped_by_budget": True})
    chosen = frames_to_fit(clip, settings.experiment.refine_frames)
    if recovery.frames is None or not len(chosen):
        return splats, recovery
    assert clip.labels is not None
    x, background = recovery.trajectory, static_background(clip) if behind is None else behind
    carried = riding(splats, recovery, clip, background, device=device)
    views = [View(clip.frames[k], clip.camera, clip.labels[k], background, carried.motion(x[k], x[0])) for k in chosen]
    steps = max(LEAST_STEPS, PASSES * len(views))
    refined = yield from told("splats", fit_views(views, splats, settings, device, iterations=steps, near=True))
    shown, others = riding(refined, recovery, clip, background, device=device).clip(x), unfitted_frames(clip, chosen)
    judged = others if len(others) else shown_frames(clip)
    before, after = (mean_psnr(clip, frames, judged) for frames in (recovery.frames, shown))
    if after <= before:
        yield Progress("splats", text=f"Gaussians of frame 0 kept: fitted to {len(chosen)} frames they show the others no better")
        return splats, recovery
    yield Progress("splats", text=f"Gaussians fitted to {len(chosen)} frames: PSNR {before:.1f} to {after:.1f} dB in the others")
    found: dict[str, object] = {"gaussians_fitted_frames": chosen.tolist(), "psnr_masked_before_refinement": recovery.metrics["psnr_masked"]}
    if len(others):
        found["psnr_masked_unfitted_frames"] = after
    return refined, replace(recovery, frames=shown, metrics=recovery.metrics | nearness(clip, shown) | found)


def riding(splats: Splats, recovery: Recovery, clip: Clip, background: np.ndarray, *, device: str) -> CarriedGaussians:
    """Gaussians on the recovered particles; background uint8 (H, W, 3)."""
    return CarriedGaussians.of(splats, recovery.trajectory[0].astype(float), clip.camera, background, device=device)


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
    return float(np.mean([psnr_masked(frames[k], clip.frames[k], object_mask(clip.labels[k])) for k in chosen]))
