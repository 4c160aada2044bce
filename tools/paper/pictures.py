"""How near a rendered clip is to the video where the video moves, and the two rows that need no physics."""

from __future__ import annotations

import cv2
import numpy as np

from diffphys_ros.metrics.image import psnr_masked, ssim_masked

MOVES = 4.0  # temporal standard deviation of a pixel that moves, of 255
FLOW_SIDE_PX = 11  # window of Farneback's polynomial; no finer detail than the tracks'


def moving(frames: np.ndarray) -> np.ndarray:
    """Pixels (H, W) whose strongest channel varies by more than MOVES over frames uint8 (T, H, W, 3), opened and dilated once."""
    mask = (frames.astype(np.float32).std(0).max(-1) > MOVES).astype(np.uint8)
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.dilate(opened, np.ones((5, 5), np.uint8))).astype(bool)


def scores(rendered: np.ndarray, video: np.ndarray, mask: np.ndarray) -> tuple[float, float]:
    """Mean masked PSNR [dB] and SSIM of the frames uint8 (T, H, W, 3) that are not frame 0 again to the last digit, which would count as perfect for a
    picture that stands still. NaN where there is none."""
    pairs = [(psnr_masked(a, b, mask), ssim_masked(a, b, mask)) for a, b in zip(rendered[1:], video[1:], strict=True) if (b != video[0])[mask].any()]
    if not pairs:
        return float("nan"), float("nan")
    psnr, ssim = np.mean(pairs, axis=0)
    return float(psnr), float(ssim)


def frozen(video: np.ndarray) -> np.ndarray:
    """Frame 0 in the place of all."""
    return np.repeat(video[:1], len(video), axis=0)


def warped(video: np.ndarray) -> np.ndarray:
    """Frame 0 moved into every frame by dense optical flow from that frame to it (Farneback 2003)."""
    first, grey = video[0], [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in video]
    v, u = np.mgrid[: first.shape[0], : first.shape[1]].astype(np.float32)
    out = [first]
    for frame in grey[1:]:
        flow = cv2.calcOpticalFlowFarneback(frame, grey[0], None, 0.5, 5, FLOW_SIDE_PX, 5, 5, 1.1, 0)  # type: ignore[call-overload]
        out.append(cv2.remap(first, u + flow[..., 0], v + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    return np.stack(out)
