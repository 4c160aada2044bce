"""Encodings of sensor_msgs/Image: bytes of a row, and rows of bytes to colour or depth.

Names are those of sensor_msgs/image_encodings.hpp. YUV is BT.601 with black at 16 and white at 235, as cameras and cv_bridge have it.
"""

from __future__ import annotations

import cv2
import numpy as np

from diffphys_ros.errors import InputError, short

MM = np.float32(1e-3)  # unit of 16-bit depth images (REP-118)
DEPTH = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
BOTH = ("mono16",)  # depth in mm, or grey where colour is asked for
ORDERED = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}  # bytes of a pixel
PACKED = {"yuv422": cv2.COLOR_YUV2RGB_UYVY, "uyvy": cv2.COLOR_YUV2RGB_UYVY, "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2, "yuyv": cv2.COLOR_YUV2RGB_YUY2}
MOSAIC = {
    "bayer_rggb": cv2.COLOR_BayerRGGB2RGB,
    "bayer_bggr": cv2.COLOR_BayerBGGR2RGB,
    "bayer_gbrg": cv2.COLOR_BayerGBRG2RGB,
    "bayer_grbg": cv2.COLOR_BayerGRBG2RGB,
}
WIDE = {f"{name}16": np.uint16 for name in MOSAIC}
CHANNELS = ORDERED | dict.fromkeys(PACKED, 2) | {f"{name}8": 1 for name in MOSAIC}  # bytes of a pixel
RGB_ORDER = {"rgb8": [0, 1, 2], "rgba8": [0, 1, 2], "mono8": [0, 0, 0], "8UC1": [0, 0, 0]}  # the others are BGR, as OpenCV stores them
KNOWN = (*CHANNELS, *WIDE, *DEPTH)
LEAST_MOSAIC = 4  # px of a side, from which on a Bayer pattern can be interpolated


def is_depth(encoding: str) -> bool | None:
    """Whether images of an encoding hold depth where nothing else says it; None where the encoding is unknown."""
    if encoding in DEPTH:
        return True
    return False if encoding in KNOWN else None


def may_be_colour(encoding: str) -> bool:
    """Whether images of an encoding can be read as colour."""
    return encoding in BOTH or is_depth(encoding) is False


def row_bytes(encoding: str, width: int) -> int:
    """Bytes of a row without padding."""
    return width * CHANNELS.get(encoding, 1) * kind_of(encoding, bigendian=False).itemsize


def check_size(encoding: str, width: int, height: int) -> None:
    """Raises InputError where an encoding has no images of this size [px]."""
    if encoding in PACKED and width % 2:
        raise InputError(f"an image of encoding {short(encoding)} has {width}x{height} px, must have an even width; record another size")
    if encoding.startswith("bayer_") and min(width, height) < LEAST_MOSAIC:
        raise InputError(f"an image of encoding {short(encoding)} has {width}x{height} px, must have {LEAST_MOSAIC} px a side at least; record it larger")


def kind_of(encoding: str, *, bigendian: bool) -> np.dtype:
    """Kind of number of a pixel's channels."""
    return np.dtype(DEPTH.get(encoding) or WIDE.get(encoding, np.uint8)).newbyteorder(">" if bigendian else "<")


def colour_of(encoding: str, values: np.ndarray) -> np.ndarray:
    """RGB (H, W, 3) uint8 of the values (H, W, C) of an image that `may_be_colour`."""
    if encoding in PACKED:
        return cv2.cvtColor(np.ascontiguousarray(values), PACKED[encoding])
    if values.dtype != np.uint8:
        values = eight_bits(values)
    if encoding.startswith("bayer_"):
        return cv2.cvtColor(np.ascontiguousarray(values[..., 0]), MOSAIC[encoding.rstrip("0123456789")])
    return values[..., [0, 0, 0] if encoding in BOTH else RGB_ORDER.get(encoding, [2, 1, 0])]


def eight_bits(values: np.ndarray) -> np.ndarray:
    """16-bit values over their full range in 8 bits."""
    return np.rint(values / np.float32(257)).astype(np.uint8)


def metres(depth: np.ndarray) -> np.ndarray:
    """Depth [m] as float32, 0 where unknown, of 16-bit millimetres or of metres with NaN or infinity where unknown."""
    if depth.dtype.kind == "u":
        return depth.astype(np.float32) * MM
    depth = depth.astype(np.float32)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))
