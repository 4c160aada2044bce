"""Gaussians that stand still while the body moves: what the mask of frame 0 takes for the object and is the scene beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.ndimage import gaussian_filter, map_coordinates

from ..types import IGNORE, Clip, Splats
from .carried import CarriedGaussians

BLUR_PX = 0.7  # of pictures that are read at the middle of a Gaussian, which is about a pixel wide [numerical]
MOVED_PX = 1.0  # displacement from which a frame tells fully which of two places a Gaussian has in it [chosen]
TOLD = 1.0  # frames in which it has moved so far that it takes to tell [chosen]
WRONG = 6.0  # rms error [of 255] of one that moves with the body from which it may be the scene's [chosen]
TIMES = 4.0  # by which that error, squared, is larger than that of standing still [chosen]
HALF = 0.5  # of a pixel of frame 0 that such Gaussians fill, from which it is the scene's [derived: most of it]
MOST = 0.2  # share of the Gaussians that may be the scene's: where it is more the motion is wrong, not the mask [chosen]


def scene_in_mask(splats: Splats, carried: CarriedGaussians, x: np.ndarray, shown: np.ndarray, clip: Clip) -> tuple[np.ndarray, np.ndarray]:
    """Which Gaussians belong to the scene, bool (G,), and which pixels of frame 0 they fill, bool (H, W); none where they were too many. `shown` uint8
    (T, H, W, 3) are the pictures as they are with particles at x (T, P, 3).

    In each frame a Gaussian shows its colour of frame 0 where it is carried to, or where it was in frame 0. What is wrong counts only where the
    picture as it is is wrong, too: one that stands still behind a leaf is hidden by what is shown there rightly."""
    stays = _stands_still(carried, x, shown, clip)
    white = np.repeat(stays[:, None], 3, 1).astype(np.float32)
    marked = replace(carried, color=torch.as_tensor(white, device=carried.mean.device), background=torch.zeros_like(carried.background))
    place = torch.as_tensor(x[:1], dtype=torch.float32, device=carried.mean.device)
    with torch.no_grad():
        share = marked.render(place, place[0], None, None)[0][0, ..., 0].cpu().numpy()
    stays |= _read(share, clip.camera.project(splats.mean.astype(float))[0]) > HALF  # what lies under the others comes along
    if stays.mean() > MOST:
        return np.zeros_like(stays), np.zeros(share.shape, bool)
    return stays, share > HALF


def _stands_still(carried: CarriedGaussians, x: np.ndarray, shown: np.ndarray, clip: Clip) -> np.ndarray:
    """Bool (G,)."""
    place = torch.as_tensor(x, dtype=torch.float32, device=carried.mean.device)
    began = clip.camera.project(carried.mean.cpu().numpy().astype(float))[0]
    own = values_at(_soft(clip.frames[0]), began)
    moving, standing, weights = (np.zeros(len(own)) for _ in range(3))
    for k in np.flatnonzero(clip.seen)[1:]:
        with torch.no_grad():
            there = clip.camera.project(carried.moved(place[k : k + 1], place[0], None)[0][0].cpu().numpy().astype(float))[0]
        seen, known = _soft(clip.frames[k]), clip.labels[k] != IGNORE  # type: ignore[index]
        wrong = np.square(_soft(shown[k]) - seen).mean(-1) * known
        weight = np.minimum(np.linalg.norm(there - began, axis=1) / MOVED_PX, 1) ** 2
        for error, at in ((moving, there), (standing, began)):
            error += weight * np.minimum(np.square(values_at(seen, at) - own).mean(-1), _read(wrong, at))
        weights += weight
    return (weights > TOLD) & (moving > WRONG**2 * weights) & (moving > TIMES * standing)


def _soft(picture: np.ndarray) -> np.ndarray:
    """Float (H, W, 3)."""
    return gaussian_filter(picture.astype(np.float32), (BLUR_PX, BLUR_PX, 0))


def values_at(picture: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Of a picture (H, W, C) at pixels (G, 2), bilinear, beyond the border those on it, (G, C)."""
    return np.stack([_read(picture[..., channel], pixels) for channel in range(picture.shape[-1])], -1)


def _read(values: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Values (H, W) at pixels (G, 2), bilinear, beyond the border those on it, (G,)."""
    return np.asarray(map_coordinates(values, pixels.T[::-1], order=1, mode="nearest"))
