"""What the appearance allows: the Gaussians of frame 0, colours and opacities constant in time, each moved by free flow and by no physics."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np
import torch

from diffphys_ros.config import Settings
from diffphys_ros.depth import placed, surface_depth
from diffphys_ros.devices import usable
from diffphys_ros.inverse import fit_gaussians, label
from diffphys_ros.inverse.evidence.pixels import static_background
from diffphys_ros.inverse.left_behind import values_at
from diffphys_ros.render import Rasterizer
from diffphys_ros.types import Clip, Splats

ROUNDS = 3  # of flow from what is shown to the video: the first from frame 0, the others mend what it missed [numerical]

T = TypeVar("T")


def moved_freely(clip: Clip, settings: Settings) -> np.ndarray:
    """Frames uint8 (T, H, W, 3): frame 0 itself, then the Gaussians that the settings make of it over the static scene, at constant depth where dense
    optical flow (DIS) takes them; the best of ROUNDS per frame. Raises InputError where no object is found."""
    device = usable(settings.fit.device)
    clip = placed(label(clip, settings), settings)
    behind = static_background(clip, edge_px=settings.experiment.splat_edge_px)
    splats = _driven(fit_gaussians(clip, surface_depth(clip, settings)[0], settings, behind=behind))
    shown = [clip.frames[0]]
    for frame in clip.frames[1:]:
        shown.append(_nearest(splats, frame, clip, behind, device))
    return np.stack(shown)


def _nearest(splats: Splats, frame: np.ndarray, clip: Clip, behind: np.ndarray, device: str) -> np.ndarray:
    """The picture nearest to a frame (H, W, 3) of those that ROUNDS of flow lead to."""
    picture, mean, found = clip.frames[0], splats.mean.astype(float), []
    for _ in range(ROUNDS):
        pixels, depth = clip.camera.project(mean)
        mean = clip.camera.backproject(pixels + values_at(_flow(picture, frame), pixels), depth)
        picture = _picture(replace(splats, mean=mean.astype(np.float32)), clip, behind, device)
        found.append((float(np.square(picture.astype(float) - frame).mean()), picture))
    return min(found, key=lambda each: each[0])[1]


def _picture(splats: Splats, clip: Clip, behind: np.ndarray, device: str) -> np.ndarray:
    """Of Gaussians over the scene, uint8 (H, W, 3)."""
    mean, rotation, scale, opacity, color = (torch.as_tensor(a, dtype=torch.float32, device=device) for a in vars(splats).values())
    over = torch.as_tensor(behind, device=device).float() / 255
    with torch.no_grad():
        image = Rasterizer(clip.camera, device).render_frames(mean[None], rotation[None], scale, opacity, color, over, window=None)[0][0]
    return (image.clamp(0, 1) * 255).round().to(torch.uint8).cpu().numpy()


def _flow(first: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Dense optical flow [px] (H, W, 2) between two pictures (H, W, 3)."""
    method = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    method.setFinestScale(0)
    return np.asarray(method.calc(*(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (first, other)), None))


def _driven(steps: Generator[object, None, T]) -> T:
    """What a generator returns."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            return stop.value  # type: ignore[no-any-return]
