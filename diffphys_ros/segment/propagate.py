"""Labels of frame 0 carried to every frame by dense optical flow."""

from __future__ import annotations

import cv2
import numpy as np


def propagate(frames: np.ndarray, seen: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Label images (T, H, W) uint8 from that of frame 0 (H, W).

    DIS flow (Kroeger et al. 2016) from every frame straight back to frame 0, started from the flow of the frame before, so that
    errors do not add up; each pixel takes the label that it came from. Frames (T, H, W, 3) RGB; frames that were not received
    (`seen` false) repeat the labels before them.
    """
    flow_of = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
    grid = np.stack(np.meshgrid(np.arange(first.shape[1]), np.arange(first.shape[0])), -1).astype(np.float32)
    labels, flow = np.repeat(first[None], len(frames), 0), None
    for k in range(1, len(frames)):
        if not seen[k]:
            labels[k] = labels[k - 1]
            continue
        flow = flow_of.calc(grey[k], grey[0], flow)
        labels[k] = _warped(first, grid + flow)
    return labels


def _warped(first: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The label image read at pixel positions `source` (H, W, 2): the label with the largest bilinear share."""
    values = np.unique(first)
    shares = [cv2.remap((first == value).astype(np.float32), source, None, cv2.INTER_LINEAR) for value in values]
    return values[np.argmax(shares, 0)].astype(np.uint8)
