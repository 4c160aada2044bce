"""The scene behind the object read again once the motion is known: from all frames, each with the weight that what covers it leaves it there."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace

import numpy as np
import torch

from ..config import Settings
from ..devices import usable
from ..progress import Progress
from ..types import IGNORE, Clip, Recovery, Splats
from .answer import nearness
from .carried import CarriedGaussians
from .clock import Clock
from .prepared import Prepared
from .refine import riding

HELD = 0.1  # weight of the scene as it was read before, where a frame that shows it uncovered has 1: what is hardly ever seen stays [chosen]
COVERED = 0.01  # opacity of the object's from which a pixel is read again: elsewhere nothing moves, and the median stays [numerical]


def uncover(
    prepared: Prepared, splats: Splats, recovery: Recovery, settings: Settings, *, behind: np.ndarray, clock: Clock | None = None
) -> Generator[Progress, None, tuple[np.ndarray, Recovery]]:
    """The scene behind the object uint8 (H, W, 3), constant in time, as all frames show it where the object as it was simulated uncovers it, and the
    recovery with frames and image metrics over that; motion, fields and Gaussians stay. Both as they were where the video comes no nearer, or the
    clock says so. Yields news."""
    clip = prepared.clip
    if recovery.frames is None or clip.labels is None or not (clock is None or clock.allows_refinement()):
        return behind, recovery
    carried = riding(splats, recovery, clip, behind, device=usable(settings.fit.device))
    scene = scene_uncovered(carried, recovery.trajectory, clip)
    shown = replace(carried, background=torch.as_tensor(scene, device=carried.mean.device).float() / 255).clip(recovery.trajectory)
    found, before = nearness(clip, shown), recovery.metrics["psnr_masked"]
    if found["psnr_masked"] <= before:  # type: ignore[operator]
        return behind, recovery
    yield Progress("splats", text=f"scene read again where the object uncovers it: PSNR {before:.1f} to {found['psnr_masked']:.1f} dB")
    return scene, replace(recovery, frames=shown, metrics=recovery.metrics | found | {"psnr_masked_before_uncovering": before})


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
