"""One image message to an array: plain functions of its fields, the same for bags and for live topics.

Colour comes out as RGB uint8 (H, W, 3); depth as float32 metres along the optical axis (H, W), 0 where unknown.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np

from diffphys_ros.errors import InputError, short

MM = np.float32(1e-3)  # unit of 16-bit depth images (REP-118)
DEPTH = {"16UC1": np.uint16, "mono16": np.uint16, "32FC1": np.float32}
CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "8UC4": 4, "mono8": 1, "8UC1": 1}
RGB_ORDER = {"rgb8": [0, 1, 2], "rgba8": [0, 1, 2], "mono8": [0, 0, 0], "8UC1": [0, 0, 0]}  # the others are BGR, as OpenCV stores them
INVERSE_DEPTH_HEADER = struct.Struct("<iff")  # of compressed_depth_image_transport: format, then the quantisation's two numbers
PNG_MAGIC, JPEG_MAGIC = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers that carry the picture's size
JPEG_BARE = {0x01, *range(0xD0, 0xD9)}  # markers without a length
JPEG_SCAN = b"\xff\xda"
MAX_SCANS = 100  # of a JPEG; a progressive one has about ten, and each is a pass over the whole picture
MAX_PIXELS = 2**25  # of an image: those of 8K video, 7680 x 4320


def is_depth(encoding: str) -> bool | None:
    """Whether images of an `encoding` of sensor_msgs/Image hold depth; None where the encoding is unknown."""
    if encoding in DEPTH:
        return True
    return False if encoding in CHANNELS else None


def decode_image(encoding: str, height: int, width: int, step: int, is_bigendian: bool | int, data: bytes | np.ndarray) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/Image.

    Raises InputError for an unknown encoding, for more than MAX_PIXELS and where `data` holds less than `height` rows of `step` bytes.
    """
    check_image(encoding, height, width, step, len(data))
    raw, used = np.frombuffer(data, np.uint8), row_bytes(encoding, width)
    rows = np.ndarray((height, used), np.uint8, raw, strides=(step or used, 1))  # no padding is read: the last row may lack it
    if is_depth(encoding):
        return metres(np.ascontiguousarray(rows).view(np.dtype(DEPTH[encoding]).newbyteorder(">" if is_bigendian else "<")))
    return rows.reshape(height, width, -1)[..., RGB_ORDER.get(encoding, [2, 1, 0])]


def check_image(encoding: str, height: int, width: int, step: int, size: int) -> None:
    """Raises InputError where `size` bytes are no image of these fields; reads and allocates nothing."""
    if is_depth(encoding) is None:
        raise InputError(f"image encoding {short(encoding)} is unknown; convert to one of {', '.join([*CHANNELS, *DEPTH])}")
    if height <= 0 or width <= 0:
        raise InputError(f"an image has {width}x{height} px, must have some; leave empty images out")
    if height * width > MAX_PIXELS:
        raise InputError(f"an image has {width}x{height} px, at most {MAX_PIXELS} pixels are read; make it smaller")
    used = row_bytes(encoding, width)
    if 0 < step < used or size < (step or used) * (height - 1) + used:
        raise InputError(f"an image holds {size} bytes, its {height} rows of {used} bytes (step {step}) need more; have its sender fill in step and data")


def row_bytes(encoding: str, width: int) -> int:
    """Bytes of a row without padding."""
    return width * CHANNELS.get(encoding, 1) * np.dtype(DEPTH.get(encoding, np.uint8)).itemsize


def decode_compressed(format: str, data: bytes | np.ndarray) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/CompressedImage.

    `format` is 'jpeg', 'png', 'rgb8; jpeg compressed bgr8', '16UC1; compressedDepth png' and the like. A single-channel 16-bit
    picture is depth in mm. Raises InputError where the data is no PNG or JPEG, or one of more than MAX_PIXELS.
    """
    raw = bytes(data)
    if "compressedDepth" in format:
        return _decode_compressed_depth(format, raw)
    picture = _picture(format, raw)
    if picture.dtype == np.uint16 and picture.ndim == 2:
        return metres(picture)
    if picture.dtype != np.uint8:
        raise InputError(f"compressed image with format {short(format)} holds {picture.dtype} colour; 8 bits a channel are needed, encode it so")
    if picture.ndim == 2:
        return np.repeat(picture[..., None], 3, 2)
    # OpenCV decodes into BGR(A) whatever the encoding before compression was
    return np.ascontiguousarray(picture[..., 2::-1])


def declared_size(format: str, data: bytes | np.ndarray) -> tuple[int, int]:
    """Width and height [px] that a compressed picture declares; decodes nothing. Raises InputError where it is no PNG or JPEG, or too large."""
    raw = bytes(data)
    size = _png_size(raw) if raw.startswith(PNG_MAGIC) else _jpeg_size(raw) if raw.startswith(JPEG_MAGIC) else None
    if size is None or not size[0] * size[1]:
        raise InputError(_no_picture(format))
    if size[0] * size[1] > MAX_PIXELS:
        raise InputError(
            f"compressed image with format {short(format)} has {size[0]}x{size[1]} px, at most {MAX_PIXELS} pixels are read; make it smaller"
        )
    return size


def metres(depth: np.ndarray) -> np.ndarray:
    """Depth [m] as float32, 0 where unknown, of 16-bit millimetres or of metres with NaN or infinity where unknown."""
    if depth.dtype.kind == "u":
        return depth.astype(np.float32) * MM
    depth = depth.astype(np.float32)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def _picture(format: str, raw: bytes) -> np.ndarray:
    declared_size(format, raw)
    try:
        picture = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        picture = None
    if picture is None:
        raise InputError(_no_picture(format))
    return picture


def _no_picture(format: str) -> str:
    return f"compressed image with format {short(format)} cannot be decoded; png and jpeg can, encode it so"


def _png_size(raw: bytes) -> tuple[int, int] | None:
    """Width and height that a PNG declares; None where it declares none."""
    return struct.unpack_from(">II", raw, 16) if raw[12:16] == b"IHDR" and len(raw) >= 24 else None  # type: ignore[return-value]


def _jpeg_size(raw: bytes) -> tuple[int, int] | None:
    """Width and height that a JPEG declares; None where it declares none, or holds more scans than a picture needs."""
    if raw.count(JPEG_SCAN) > MAX_SCANS:
        return None
    at = raw.find(b"\xff", 2)
    while 0 <= at < len(raw) - 8:
        marker = raw[at + 1]
        if marker in JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", raw, at + 5)
            return width, height
        bare = marker in (0x00, 0xFF) or marker in JPEG_BARE
        at = raw.find(b"\xff", at + 1 if bare else at + 2 + struct.unpack_from(">H", raw, at + 2)[0])
    return None


def _decode_compressed_depth(format: str, raw: bytes) -> np.ndarray:
    start = raw.find(PNG_MAGIC)
    if start < 0:
        raise InputError(f"depth image with format {short(format)} holds no PNG; set the transport's compressedDepth format to png")
    picture = _picture(format, raw[start:])
    if picture.dtype != np.uint16 or picture.ndim != 2:
        raise InputError(f"depth image with format {short(format)} holds a PNG of colours, must be one channel of 16 bits; record raw 32FC1 or 16UC1 images")
    if not format.strip().startswith("32FC1"):
        return metres(picture)
    if start < INVERSE_DEPTH_HEADER.size:
        raise InputError(f"depth image with format {short(format)} lacks its quantisation header; record raw 32FC1 or 16UC1 images")
    _, a, b = INVERSE_DEPTH_HEADER.unpack_from(raw)
    with np.errstate(all="ignore"):  # what is no number is unknown depth
        return metres(np.where(picture > 0, np.float32(a) / (picture.astype(np.float32) - np.float32(b)), 0))
