"""A small grey picture of an image message: enough to see whether something moves, at a fraction of the cost of decoding it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from diffphys_ros.bags.decode import CHANNELS, row_bytes

SIDE_PX = 80  # longest side of a thumbnail


def thumbnail(message: Any) -> np.ndarray | None:
    """Mean brightness float32 (h, w) of blocks of a sensor_msgs/Image of colours or a CompressedImage; None where it cannot be decoded."""
    grey = _compressed(message) if hasattr(message, "format") else _raw(message)
    if grey is None:
        return None
    scale = max(1.0, max(grey.shape) / SIDE_PX)
    size = max(1, round(grey.shape[1] / scale)), max(1, round(grey.shape[0] / scale))
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _raw(message: Any) -> np.ndarray:
    used = row_bytes(message.encoding, message.width)
    rows = np.ndarray((message.height, used), np.uint8, message.data, strides=(message.step or used, 1))
    channels = CHANNELS[message.encoding]
    return np.ascontiguousarray(rows[:, 1::channels] if channels > 1 else rows)  # green, in either order


def _compressed(message: Any) -> np.ndarray | None:
    raw = np.frombuffer(message.data, np.uint8)
    try:
        grey = cv2.imdecode(raw, cv2.IMREAD_REDUCED_GRAYSCALE_8)
        return cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE) if grey is not None and max(grey.shape) < SIDE_PX // 2 else grey
    except cv2.error:
        return None
