"""One image message to an array: plain functions of its fields, the same for bags and for live topics.

Colour comes out as RGB uint8 (H, W, 3); depth as float32 metres along the optical axis (H, W), 0 where unknown.
"""

from __future__ import annotations

import struct

import cv2
import numpy as np

from diffphys_ros.bags.compressed_depth import HEADER, dequantised, is_compressed_depth, is_rvl, rvl_size, rvl_values
from diffphys_ros.bags.encodings import BOTH, check_size, colour_of, eight_bits, is_depth, kind_of, metres, row_bytes
from diffphys_ros.errors import InputError, short

__all__ = ["MAX_PIXELS", "check_image", "declared_size", "decode_compressed", "decode_image", "is_depth"]

PNG_MAGIC, JPEG_MAGIC = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # markers that carry the picture's size
JPEG_BARE = {0x01, *range(0xD0, 0xD9)}  # markers without a length
JPEG_SCAN = b"\xff\xda"
MAX_SCANS = 100  # of a JPEG; a progressive one has about ten, and each is a pass over the whole picture
MAX_PIXELS = 2**25  # of an image: those of 8K video, 7680 x 4320


def decode_image(
    encoding: str, height: int, width: int, step: int, is_bigendian: bool | int, data: bytes | np.ndarray, *, colour: bool = False
) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/Image; mono16 is depth unless `colour` is wanted.

    Raises InputError for an unknown encoding, for more than MAX_PIXELS and where `data` holds less than `height` rows of `step` bytes.
    """
    check_image(encoding, height, width, step, len(data))
    raw, used = np.frombuffer(data, np.uint8), row_bytes(encoding, width)
    rows = np.ndarray((height, used), np.uint8, raw, strides=(step or used, 1))  # no padding is read: the last row may lack it
    values = np.ascontiguousarray(rows).view(kind_of(encoding, bigendian=bool(is_bigendian)))
    values = values.astype(values.dtype.newbyteorder("="), copy=False).reshape(height, width, -1)
    if is_depth(encoding) and not (colour and encoding in BOTH):
        return metres(values[..., 0])
    return colour_of(encoding, values)


def check_image(encoding: str, height: int, width: int, step: int, size: int) -> None:
    """Raises InputError where `size` bytes are no image of these fields; reads and allocates nothing."""
    if is_depth(encoding) is None:
        raise InputError(f"image encoding {short(encoding)} is unknown; convert to rgb8, bgr8, mono8, yuv422, a Bayer pattern such as bayer_rggb8, 16UC1 or 32FC1")
    if height <= 0 or width <= 0:
        raise InputError(f"an image has {width}x{height} px, must have some; leave empty images out")
    if height * width > MAX_PIXELS:
        raise InputError(f"an image has {width}x{height} px, at most {MAX_PIXELS} pixels are read; make it smaller")
    used = row_bytes(encoding, width)
    if 0 < step < used or size < (step or used) * (height - 1) + used:
        raise InputError(f"an image holds {size} bytes, its {height} rows of {used} bytes (step {step}) need more; have its sender fill in step and data")
    check_size(encoding, width, height)


def decode_compressed(format: str, data: bytes | np.ndarray, *, colour: bool = False) -> np.ndarray:
    """RGB (H, W, 3) uint8 or depth [m] (H, W) float32 of the fields of a sensor_msgs/CompressedImage.

    `format` is 'jpeg', 'png', 'rgb8; jpeg compressed bgr8', '16UC1; compressedDepth png' and the like. A single-channel 16-bit
    picture is depth in mm, or grey where `colour` is wanted. Raises InputError where the data is no PNG, JPEG or RVL, or one of more
    than MAX_PIXELS.
    """
    raw = bytes(data)
    if is_compressed_depth(format):
        return _decode_compressed_depth(format, raw)
    picture = _picture(format, raw)
    if picture.dtype == np.uint16 and picture.ndim == 2:
        if not colour:
            return metres(picture)
        picture = eight_bits(picture)
    if picture.dtype != np.uint8:
        raise InputError(f"compressed image with format {short(format)} holds {picture.dtype} colour; 8 bits a channel are needed, encode it so")
    if picture.ndim == 2:
        return np.repeat(picture[..., None], 3, 2)
    # OpenCV decodes into BGR(A) whatever the encoding before compression was
    return np.ascontiguousarray(picture[..., 2::-1])


def declared_size(format: str, data: bytes | np.ndarray) -> tuple[int, int]:
    """Width and height [px] that a compressed picture declares; decodes nothing. Raises InputError where it is none, or too large."""
    raw = bytes(data)
    if is_compressed_depth(format):
        size = rvl_size(format, raw) if is_rvl(format) else _picture_size(_after_header(format, raw))
    else:
        size = _picture_size(raw)
    if size is None or not size[0] * size[1]:
        raise InputError(_no_picture(format))
    if size[0] * size[1] > MAX_PIXELS:
        raise InputError(
            f"compressed image with format {short(format)} has {size[0]}x{size[1]} px, at most {MAX_PIXELS} pixels are read; make it smaller"
        )
    return size


def _picture_size(raw: bytes) -> tuple[int, int] | None:
    """Width and height that a PNG or JPEG declares; None where it is neither."""
    return _png_size(raw) if raw.startswith(PNG_MAGIC) else _jpeg_size(raw) if raw.startswith(JPEG_MAGIC) else None


def _picture(format: str, raw: bytes) -> np.ndarray:
    """What OpenCV makes of a PNG or JPEG, whatever transport it comes from."""
    declared_size("" if is_compressed_depth(format) else format, raw)
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
    picture = _rvl(format, raw) if is_rvl(format) else _picture(format, _after_header(format, raw))
    if picture.dtype != np.uint16 or picture.ndim != 2:
        raise InputError(f"depth image with format {short(format)} holds a PNG of colours, must be one channel of 16 bits; record raw 32FC1 or 16UC1 images")
    return metres(dequantised(format, raw, picture) if format.strip().startswith("32FC1") else picture)


def _rvl(format: str, raw: bytes) -> np.ndarray:
    declared_size(format, raw)
    return rvl_values(format, raw)


def _after_header(format: str, raw: bytes) -> bytes:
    """The PNG behind the transport's header."""
    if not raw.startswith(PNG_MAGIC, HEADER.size):
        raise InputError(
            f"depth image with format {short(format)} holds no PNG behind a header of {HEADER.size} bytes; set the transport's compressedDepth format to png or rvl"
        )
    return raw[HEADER.size :]
