"""Depth images of a depth camera as the colour camera would have taken them."""

from __future__ import annotations

import numpy as np

from diffphys_ros.bags.lens import Lens

CLOSER = 1.2  # how much closer than the colour camera's pixels samples of the depth lie, so that surfaces that stretch have no holes
MOST_SAMPLES = 8  # a side of a pixel


class Registration:
    """Depth along one camera's axis to depth along another's, through a buffer of the nearest.

    Args:
        lens: of the depth images. colour: of the images they are brought to. colour_from_depth: rigid transform (4, 4) [m].
    """

    def __init__(self, lens: Lens, colour: Lens, colour_from_depth: np.ndarray) -> None:
        self._size = colour.size
        coarser = max(colour.matrix[i, i] / lens.matrix[i, i] for i in (0, 1))
        self._samples = int(np.clip(np.ceil(CLOSER * coarser), 1, MOST_SAMPLES))
        u, v = (self._spread(n) for n in lens.size)
        rays = np.stack([*np.meshgrid(u, v), np.ones((len(v), len(u)))], -1) @ np.linalg.inv(lens.matrix).T
        to_pixel = colour.matrix @ colour_from_depth[:3, :3]
        self._slope = (rays @ to_pixel.T).astype(np.float32)  # homogeneous pixel in the colour image = slope * depth + start
        self._start = (colour.matrix @ colour_from_depth[:3, 3]).astype(np.float32)

    def __call__(self, depth: np.ndarray) -> np.ndarray:
        """Depth [m] (H, W) float32 in the colour image, of depth [m] of the depth image; 0 where unknown."""
        far = np.repeat(np.repeat(depth, self._samples, 0), self._samples, 1)
        known = far > 0
        with np.errstate(all="ignore"):
            place = self._slope[known] * far[known, None] + self._start
            pixel = np.rint(place[:, :2] / place[:, 2:])
        width, height = self._size
        seen = (place[:, 2] > 0) & (pixel >= 0).all(1) & (pixel[:, 0] < width) & (pixel[:, 1] < height)  # false for NaN
        index = pixel[seen].astype(np.int64) @ (1, width)
        nearest = np.full(width * height, np.inf, np.float32)
        np.minimum.at(nearest, index, place[seen, 2])
        return np.where(np.isfinite(nearest), nearest, np.float32(0)).reshape(height, width)

    def _spread(self, pixels: int) -> np.ndarray:
        """Coordinates of the samples of a row or column of pixels [px]."""
        return (np.arange(pixels * self._samples) + 0.5) / self._samples - 0.5
