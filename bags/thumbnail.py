"""A small grey picture of an image message: enough to see whether something moves, at a fraction of the cost of decoding it."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from diffphys_ros.bags.encodings import CHANNELS, eight_bits, kind_of, row_bytes

BRIGHT_FIRST = ("yuyv", "yuv422_yuy2")  # Y U Y V
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
    used, kind = row_bytes(message.encoding, message.width), kind_of(message.encoding, bigendian=bool(message.is_bigendian))
    rows = np.ndarray((message.height, used), np.uint8, message.data, strides=(message.step or used, 1))
    if kind.itemsize > 1:
        return eight_bits(np.ascontiguousarray(rows).view(kind))
    channels = CHANNELS[message.encoding]
    bright = 0 if channels == 1 or message.encoding in BRIGHT_FIRST else 1  # green, in either order, or Y
    return np.ascontiguousarray(rows[:, bright::channels])


def _compressed(message: Any) -> np.ndarray | None:
    raw = np.frombuffer(message.data, np.uint8)
    try:
        grey = cv2.imdecode(raw, cv2.IMREAD_REDUCED_GRAYSCALE_8)
        return cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE) if grey is not None and max(grey.shape) < SIDE_PX // 2 else grey
    except cv2.error:
        return None
