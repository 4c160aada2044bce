"""Which pixels of frame 0 move, and which stand still where the object beside them moves: evidence for and against it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from .regions import pixel_grid

LEAST_MOTION_PX = 1.0  # displacement from which texture is said to have moved
LEAST_GAIN = 6.0  # grey levels by which one of flow and standing still explains a pixel better than the other
STEADY = 0.3  # quantile over the frames in which a pixel must have moved, or stood still: what is merely passed over fails it
LEAST_CLAIMS = 0.2  # share of the frames in which it must have moved, or should have
STILL_MOTION_PX = 3.0  # that a piece of the object would show at the least, from which a pixel that stands still is none
STEEPNESS = 1.0  # of the largest motion over the size of the region that moves: how fast the motion may fall off towards a root
LARGEST = 0.95  # quantile that stands for the largest motion
MOST_FRAMES = 24
WINDOW_PX = 7  # side of the window over which differences are averaged
SPECK_PX = 3  # what is narrower is no evidence
BLUR_PX = 31  # and of that over which the motion of the nearest moving pixels is


@dataclass(frozen=True)
class Movement:
    """The optical flow (DIS) from frame 0 to some frames of a clip, believed only where it explains them.

    Dense flow bleeds far into plain background: a pixel moves where the flow explains the frames better than standing still does, in
    most of the frames in which it claims motion.
    """

    frames: np.ndarray  # RGB, the first and those looked at, uint8 (K + 1, H, W, 3)
    flow: np.ndarray  # from the first to the others [px], float16, (K, H, W, 2)
    moving: np.ndarray  # bool, (H, W)

    @classmethod
    def of(cls, frames: np.ndarray) -> Movement:
        """Of frames (T, H, W, 3), T >= 2."""
        chosen = np.unique(np.linspace(1, len(frames) - 1, min(MOST_FRAMES, len(frames) - 1)).astype(int))
        frames = frames[np.r_[0, chosen]]
        grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
        dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        flow = np.stack([dis.calc(grey[0], other, None).astype(np.float16) for other in grey[1:]])
        return cls(frames, flow, _steady(frames, flow, np.full(len(flow), LEAST_MOTION_PX), 1.0))

    def steadily(self, least_px: float, gain: float, share: float) -> np.ndarray:
        """Pixels that moving along explains better than standing still by `gain` grey levels, in all but a `share` of the frames in which they
        are said to move by `least_px`: bool (H, W)."""
        return _steady(self.frames, self.flow, np.full(len(self.flow), least_px), 1.0, gain, share)

    def reach_px(self) -> np.ndarray:
        """How far each pixel moves in most frames [px], float32 (H, W)."""
        return np.quantile(np.linalg.norm(self.flow.astype(np.float32), axis=-1), LARGEST, axis=0).astype(np.float32)

    def still(self, core: np.ndarray) -> np.ndarray:
        """Pixels that stand still while the nearest moving ones of `core` (H, W) move, and would look otherwise had they moved along:
        bool (H, W).

        Plain surfaces never are: nothing can be said of them. Nor is a held root: with the distance from what moves an ever larger share
        of its motion may be lost.
        """
        sure = core & self.moving
        if not sure.any():
            return np.zeros(core.shape, bool)
        distance, nearest = distance_transform_edt(~sure, return_indices=True)
        size_px = float(np.linalg.norm([np.ptp(index) + 1.0 for index in np.nonzero(sure)]))
        along, least = np.empty(self.flow.shape, np.float32), []
        for k, flow in enumerate(self.flow):
            along[k] = cv2.blur(flow[tuple(nearest)].astype(np.float32), (BLUR_PX, BLUR_PX))
            largest = np.quantile(np.linalg.norm(flow[sure].astype(np.float32), axis=1), LARGEST)
            least.append(STILL_MOTION_PX + STEEPNESS * largest / size_px * distance)
        still = _steady(self.frames, along, np.stack(least), -1.0) & ~self.moving
        return cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_OPEN, np.ones((SPECK_PX, SPECK_PX), np.uint8)) > 0


def _steady(
    frames: np.ndarray, flow: np.ndarray, least_px: np.ndarray, sign: float, least_gain: float = LEAST_GAIN, share: float = STEADY
) -> np.ndarray:
    """Pixels (H, W) that moving by `flow` (K, H, W, 2) explains better than standing still (sign 1) or worse (-1), by `least_gain`, in all but
    a `share` of the frames in which it is longer than `least_px` (K,) or (K, H, W)."""
    pairs = zip(frames[1:], flow, least_px, strict=True)
    gain = np.stack([_gain(frames[0], other, step.astype(np.float32), least, sign) for other, step, least in pairs])
    claims = np.isfinite(gain).sum(0)
    rank = np.clip((share * claims).astype(int), 0, len(gain) - 1)
    steady = np.take_along_axis(np.sort(gain, 0), rank[None], 0)[0]
    return (claims >= max(2, int(LEAST_CLAIMS * len(gain)))) & (steady > least_gain)


def _gain(first: np.ndarray, other: np.ndarray, flow: np.ndarray, least_px: float | np.ndarray, sign: float) -> np.ndarray:
    """`sign` times the grey levels by which the flow explains each pixel of the first frame better than standing still, float32 (H, W);
    inf where it is shorter than `least_px`."""
    moved = cv2.remap(other, pixel_grid(first.shape) + flow, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = sign * (_difference(first, other) - _difference(first, moved))
    averaged = cv2.boxFilter(difference, -1, (WINDOW_PX, WINDOW_PX))
    return np.where(np.linalg.norm(flow, axis=-1) > least_px, averaged, np.inf).astype(np.float32)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.abs(a.astype(np.float32) - b).max(-1)
