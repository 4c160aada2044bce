"""The scene behind the object read again once the motion is known: from all frames, each with the weight that what covers it leaves it there."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import torch

from ..config import Settings
from ..devices import usable
from ..progress import Progress, told
from ..splats import View, fit_views
from ..types import IGNORE, Clip, Recovery, Splats, object_mask
from .answer import nearness, shown_frames
from .carried import CarriedGaussians
from .clock import Clock
from .left_behind import scene_in_mask
from .prepared import Prepared
from .refine import riding

HELD = 0.1  # weight of the scene as it was read before, where a frame that shows it uncovered has 1: what is hardly ever seen stays [chosen]
COVERED = 0.01  # opacity of the object's from which a pixel is read again: elsewhere nothing moves, and the median stays [numerical]
MENDING = 40  # steps by which Gaussians fill frame 0 where others of them are left behind [numerical]


def uncover(
    prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings, *, behind: np.ndarray, clock: Clock | None = None
) -> Generator[Progress, None, tuple[Splats, np.ndarray, Recovery]]:
    """Gaussians, the scene behind them uint8 (H, W, 3), constant in time, as all frames show it where the object as it was simulated uncovers it, and the
    recovery with frames and image metrics over that; motion and fields stay. Under the published schedule, Gaussians that stand still become part of the
    scene, and the others are fitted to frame 0 over it. All as they were where the video comes no nearer, or the clock says so. Yields news."""
    clip, before, given = prepared.clip, recovery.metrics.get("psnr_masked"), (splats, behind, recovery)
    if recovery.frames is None or clip.labels is None or not (clock is None or clock.allows_refinement()):
        return given
    x, device = recovery.trajectory, usable(settings.fit.device)
    carried = riding(splats, recovery, clip, behind, device=device)
    scene = scene_uncovered(carried, x, clip)
    shown = carried.over(scene).clip(x)
    found: list[tuple[Splats, np.ndarray, np.ndarray, dict[str, object]]] = [(splats, scene, shown, {})]
    if settings.experiment.published:
        stays, pixels = scene_in_mask(splats, carried, x, shown, clip)
        for fewer, other in (yield from _left_behind(prepared, splats, recovery, settings, behind, stays, pixels)) if stays.any() else []:
            instead = riding(fewer, recovery, clip, other, device=device).clip(x)
            found.append((fewer, other, instead, {"gaussians_left_behind": int(stays.sum())}))
    found = [each for each in found if nearness(clip, each[2])["psnr_masked"] >= before]  # type: ignore[operator]
    splats, scene, shown, counted = min(found, key=lambda each: _error(clip, each[2]), default=(*given[:2], recovery.frames, {}))
    if _error(clip, shown) >= _error(clip, recovery.frames):
        return given
    metrics = nearness(clip, shown) | counted | {"psnr_masked_before_uncovering": before}
    yield Progress("splats", text=f"scene read again where the object uncovers it: PSNR {before:.1f} to {metrics['psnr_masked']:.1f} dB")
    return splats, scene, replace(recovery, frames=shown, metrics=recovery.metrics | metrics)


def _error(clip: Clip, frames: np.ndarray) -> float:
    """Mean square of (T, H, W, 3) over the region where the object is seen in any frame: what it uncovers is no part of the mask of that frame."""
    region = object_mask(clip.labels).any(0)  # type: ignore[arg-type]
    return float(np.mean([np.square(frames[k][region].astype(np.float32) - clip.frames[k][region]).mean() for k in shown_frames(clip)]))


def _left_behind(
    prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings, behind: np.ndarray, stays: np.ndarray, pixels: np.ndarray
) -> Generator[Progress, None, list[tuple[Splats, np.ndarray]]]:
    """Gaussians without those that belong to the scene, and the scene with these; the same, fitted to frame 0 beside the scene's `pixels` (H, W)."""
    clip, device, x = prepared.clip, usable(settings.fit.device), recovery.trajectory
    assert clip.labels is not None
    fewer = Splats(*(values[~stays] for values in vars(splats).values()))
    carried = riding(fewer, recovery, clip, np.where(pixels[..., None], clip.frames[0], behind), device=device)
    scene = scene_uncovered(carried, x, clip)
    labels = np.where(pixels & (clip.labels[0] != IGNORE), 0, clip.labels[0])
    view = View(clip.frames[0], clip.camera, labels, scene, carried.motion(x[0], x[0]))
    mended = yield from told("splats", fit_views([view], fewer, settings, device, iterations=MENDING, near=True))
    return [(fewer, scene), (mended, scene_uncovered(riding(mended, recovery, clip, scene, device=device), x, clip))]


def scene_uncovered(carried: CarriedGaussians, x: np.ndarray, clip: Clip) -> np.ndarray:
    """Scene uint8 (H, W, 3) for which the pictures of Gaussians over it, moved by particles x (T, P, 3), come nearest to the clip: by least squares
    of each pixel by itself, c = f + (1 - a) s in each frame, from the scene that the Gaussians are over now."""
    weights, missing = torch.full_like(carried.background[..., :1], HELD), torch.zeros_like(carried.background)
    reached, place = torch.zeros_like(weights, dtype=torch.bool), torch.as_tensor(x, dtype=torch.float32, device=missing.device)
    with torch.no_grad():
        for k in np.flatnonzero(clip.seen):
            image, alpha, _ = carried.render(place[k : k + 1], place[0], None, None)
            seen = torch.as_tensor(clip.frames[k], device=missing.device).float() / 255
            known = torch.as_tensor(clip.labels[k] != IGNORE, device=missing.device)[..., None]  # type: ignore[index]
            through = (1 - alpha[0, ..., None]) * known
            weights += through**2
            missing += through * (seen - image[0])
            reached |= alpha[0, ..., None] > COVERED
        scene = carried.background + torch.where(reached, missing / weights, 0.0)
    return (scene.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()
