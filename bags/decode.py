"""One image message to an array: plain functions of its fields, the same for bags and for live topics.

Colour comes out as RGB uint8 (H, W, 3); depth as float32 metres along the optical axis (H, W), 0 where unknown.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np

from diffphys_ros.errors import InputError

MM = np.float32(1e-3)  # unit of 16-bit depth images (REP-118)
DEPTH = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}
RGB_ORDER = {"rgb8": [0, 1, 2], "rgba8": [0, 1, 2], "mono8": [0, 0, 0], "8UC1": [0, 0, 0]}  # the others are BGR, as OpenCV stores them
INVERSE_DEPTH_HEADER = struct.Struct("<iff")  # of compressed_depth_image_transport: format, then the quantisation's two numbers
PNG_MAGIC = b"\x89PNG"


def is_depth(encoding: str) -> bool | None:
    """Whether images of an `encoding` of sensor_msgs/Image hold depth; None where the encoding is unknown."""
    if encoding in DEPTH:
        return True
    return False if encoding in CHANNELS else None


def decode_image(encoding: str, height: int, width: int, step: int, is_bigendian: bool | int, data: bytes | np.ndarray) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/Image.

    Raises InputError for an unknown encoding and where `data` holds less than `height` rows of `step` bytes.
    """
    depth = is_depth(encoding)
    if depth is None:
        raise InputError(f"image encoding {encoding!r} is unknown; convert to one of {', '.join([*CHANNELS, *DEPTH])}")
    kind = np.dtype(DEPTH.get(encoding, np.uint8)).newbyteorder(">" if is_bigendian else "<")
    rows = _rows(data, height, width * CHANNELS.get(encoding, 1) * kind.itemsize, step)
    if depth:
        return metres(np.ascontiguousarray(rows).view(kind))
    return rows.reshape(height, width, -1)[..., RGB_ORDER.get(encoding, [2, 1, 0])]


def decode_compressed(format: str, data: bytes | np.ndarray) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/CompressedImage.

    `format` is 'jpeg', 'png', 'rgb8; jpeg compressed bgr8', '16UC1; compressedDepth png' and the like. A single-channel 16-bit
    picture is depth in mm. Raises InputError where the data is no picture.
    """
    raw = np.frombuffer(data, np.uint8)
    if "compressedDepth" in format:
        return _decode_compressed_depth(format, raw)
    picture = _picture(format, raw)
    if picture.dtype == np.uint16 and picture.ndim == 2:
        return metres(picture)
    if picture.dtype != np.uint8:
        raise InputError(f"compressed image with format {format!r} holds {picture.dtype} colour; 8 bits a channel are needed, record it so")
    if picture.ndim == 2:
        return np.repeat(picture[..., None], 3, 2)
    # OpenCV decodes into BGR(A) whatever the encoding before compression was
    return np.ascontiguousarray(picture[..., 2::-1])


def metres(depth: np.ndarray) -> np.ndarray:
    """Depth [m] as float32, 0 where unknown, of 16-bit millimetres or of metres with NaN or infinity where unknown."""
    if depth.dtype.kind == "u":
        return depth.astype(np.float32) * MM
    depth = depth.astype(np.float32)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def _rows(data: bytes | np.ndarray, height: int, used: int, step: int) -> np.ndarray:
    raw = np.frombuffer(data, np.uint8)
    step = step or used
    if height <= 0 or used <= 0 or step < used or raw.size < step * (height - 1) + used:
        raise InputError(f"an image holds {raw.size} bytes, its {height} rows of {used} bytes (step {step}) need more; record it again")
    padded = raw[: step * height]
    if padded.size < step * height:  # the last row may lack its padding
        padded = np.pad(padded, (0, step * height - padded.size))
    return padded.reshape(height, step)[:, :used]


def _picture(format: str, raw: np.ndarray) -> np.ndarray:
    picture = cv2.imdecode(raw, cv2.IMREAD_UNCHANGED) if raw.size else None
    if picture is None:
        raise InputError(f"compressed image with format {format!r} cannot be decoded; png and jpeg can, record it so")
    return picture


def _decode_compressed_depth(format: str, raw: np.ndarray) -> np.ndarray:
    start = raw.tobytes().find(PNG_MAGIC)
    if start < 0:
        raise InputError(f"depth image with format {format!r} holds no PNG; set the transport's compressedDepth format to png")
    picture = _picture(format, raw[start:])
    if not format.strip().startswith("32FC1"):
        return metres(picture)
    if start < INVERSE_DEPTH_HEADER.size:
        raise InputError(f"depth image with format {format!r} lacks its quantisation header; record raw 32FC1 or 16UC1 images")
    _, a, b = INVERSE_DEPTH_HEADER.unpack(raw[: INVERSE_DEPTH_HEADER.size].tobytes())
    with np.errstate(divide="ignore"):
        return metres(np.where(picture > 0, np.float32(a) / (picture.astype(np.float32) - np.float32(b)), 0))
