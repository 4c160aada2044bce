"""A held strip that swings before a background, filmed by cameras good and bad."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from diffphys_ros.types import Camera, Clip, Tracks

FRAMES, HEIGHT, WIDTH, MARGIN = 14, 240, 320, 80
CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), np.eye(4), WIDTH, HEIGHT)
ROOT, SIZE = (150.0, 100.0), 40  # px
PX_M = 1e-3  # size of a pixel on the strip

STILL = np.zeros((FRAMES, 2))


def pan(px: float) -> np.ndarray:
    """Shifts (T, 2) [px] of a camera that turns steadily."""
    return np.outer(np.arange(FRAMES), (px, 0.0))


def shake(px: float, seed: int = 0) -> np.ndarray:
    """Shifts (T, 2) [px] of one held in the hand."""
    moved = px * np.random.default_rng(seed).standard_normal((FRAMES, 2))
    return moved - moved[0]


@cache
def wall() -> np.ndarray:
    """Patterned all over."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).uniform(0, 255, (HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)).astype(np.float32), (0, 0), 3)
    return 60 + 120 * (noise - noise.min()) / np.ptp(noise)


@cache
def plain() -> np.ndarray:
    """Without any mark."""
    return np.full((HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN), 150, np.float32) + np.linspace(0, 20, WIDTH + 2 * MARGIN, dtype=np.float32)


def filmed(
    ground: np.ndarray, shift: np.ndarray, *, noise: float = 0.1, shadow: bool = False, branch: bool = False, drift: bool = False
) -> tuple[Clip, Tracks]:
    """Clip with labels, and tracks, of a camera shifted by (T, 2) [px].

    noise: of the sensor [grey levels]. shadow: one wanders over the wall. branch: the left third of the picture swings in the wind.
    drift: the exposure does.
    """
    rng, frames, labels = np.random.default_rng(1), [], []
    for k, (dx, dy) in enumerate(shift):
        frame = _window(ground, dx, dy)
        if branch:
            frame[:, :100] = _window(wall(), 6 * np.sin(0.7 * k), 0.0)[:, :100]
        if shadow:
            x = np.arange(WIDTH)
            frame = frame * (1 - 0.4 / (1 + np.exp(-(x - 60 - 6 * k) / 3)) / (1 + np.exp((x - 160 - 6 * k) / 3)))
        if drift:
            frame = frame * (1 + 0.08 * np.sin(k / 5))
        label = np.zeros((HEIGHT, WIDTH), np.uint8)
        left, top = int(ROOT[0] - dx), int(ROOT[1] - dy)
        label[max(top - 20, 0) : top + 60, max(left, 0) : max(left + SIZE, 0)] = 1
        frame = np.where(label > 0, wall()[: HEIGHT, : WIDTH], frame) + noise * rng.standard_normal(frame.shape)
        frames.append(np.repeat(np.clip(np.rint(frame), 0, 255).astype(np.uint8)[..., None], 3, 2))
        labels.append(label)
    return Clip(np.array(frames), 0, 1 / 30, CAMERA, labels=np.array(labels)), tracked(shift)


def tracked(shift: np.ndarray) -> Tracks:
    """Thirty points from the root, which is held, to the tip, which swings."""
    along = np.linspace(0, 1, 30)
    start = np.array(ROOT) + SIZE * along[:, None]
    swing = 10 * np.sin(0.6 * np.arange(FRAMES))[:, None] * along**2
    pixels = start - shift[:, None] + np.stack([swing, 0 * swing], -1)
    points = np.concatenate([pixels, np.zeros((*swing.shape, 1))], -1) * PX_M
    return Tracks(pixels, points, np.ones(swing.shape, bool), False, 0.05 * PX_M)


def _window(ground: np.ndarray, dx: float, dy: float) -> np.ndarray:
    to = np.array([[1, 0, -MARGIN - dx], [0, 1, -MARGIN - dy]])
    return np.asarray(cv2.warpAffine(ground, to, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC))


def untracked(tracks: Tracks) -> Tracks:
    """The same tracks, none of which holds after frame 0."""
    return replace(tracks, valid=tracks.valid & (np.arange(len(tracks.valid)) == 0)[:, None])
