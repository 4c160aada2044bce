"""A camera's drifting exposure and white balance, read off what stands still and taken off."""

from __future__ import annotations

import cv2
import numpy as np

BLOCK_PX = 8  # side of the blocks whose mean brightness is compared: sensor noise averages out
DARKEST, BRIGHTEST = 16.0, 235.0  # mean levels of a block that show a gain: above black level, below saturation
AGREEING = 0.015  # difference of log gains within which two blocks say the same
LEAST_SUPPORT = 0.4  # share of the blocks that must agree on a gain
LEAST_BLOCKS = 30
LEAST_DRIFT = 0.006  # largest log gain of a clip below which it is left as it is: less than a grey level at middle grey


def with_steady_exposure(frames: np.ndarray, *, out: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Frames (T, H, W, 3) uint8 as frame 0 was exposed, and the largest relative gain that was taken off (0: none).

    Each channel of each frame is divided by its gain over frame 0. The frames come back as they are where the gains are too small
    to matter, or where most of the picture changes otherwise, so that no gain explains it. `out` takes them, and may be `frames` itself.
    """
    gains = exposure_gains(frames)
    if gains is None or np.abs(np.log(gains)).max() < LEAST_DRIFT:
        return frames, 0.0
    tables = np.clip(np.rint(np.arange(256)[:, None] / gains[:, None]), 0, 255).astype(np.uint8)  # (T, 256, 3)
    steady = np.empty_like(frames) if out is None else out
    for k, (frame, table) in enumerate(zip(frames, tables, strict=True)):
        steady[k] = cv2.LUT(frame, table[:, None])
    return steady, float(np.abs(gains - 1).max())


def exposure_gains(frames: np.ndarray) -> np.ndarray | None:
    """Gain of every frame and channel over frame 0, (T, 3), of frames (T, H, W, 3); None where too little of the picture agrees on one.

    The gain is the ratio of brightness on which most blocks of the picture agree: what moves is outvoted by what does not.
    """
    means = np.stack([_block_means(frame) for frame in frames])
    usable = (means > DARKEST) & (means < BRIGHTEST)
    gains = np.ones((len(frames), 3))
    for k in range(1, len(frames)):
        for c in range(3):
            both = usable[0, :, c] & usable[k, :, c]
            ratio = np.log(means[k, both, c]) - np.log(means[0, both, c])
            if len(ratio) < LEAST_BLOCKS:
                return None
            agreeing = np.abs(ratio - np.median(ratio)) < AGREEING
            if agreeing.mean() < LEAST_SUPPORT:
                return None
            gains[k, c] = np.exp(ratio[agreeing].mean())
    return gains


def _block_means(frame: np.ndarray) -> np.ndarray:
    """Mean levels (N, 3) of the blocks of a frame."""
    size = max(1, frame.shape[1] // BLOCK_PX), max(1, frame.shape[0] // BLOCK_PX)
    return cv2.resize(frame.astype(np.float32), size, interpolation=cv2.INTER_AREA).reshape(-1, 3)
