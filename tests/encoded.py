"""One known picture and one known depth in every encoding, made here by the encodings' definitions; both ways into a clip must give them back."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np

HEIGHT, WIDTH = 12, 16
PADDING = 5  # bytes at the end of every row
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


class Encoded(NamedTuple):
    """Fields of a message without its header, and what must come out of it."""

    kind: str
    fields: dict[str, Any]
    expected: np.ndarray
    atol: float


def picture() -> np.ndarray:
    """RGB that changes slowly and differs in every channel; the two pixels of a pair are alike, as YUV 4:2:2 has it."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    u = u // 2 * 2
    return np.stack([40 + 10 * u, 200 - 8 * v, 60 + 3 * u + 5 * v], -1).astype(np.uint8)


def millimetres() -> np.ndarray:
    """Depth with pixels that are not known, among them a whole row and the last pixel."""
    depth = (500 + 7 * np.arange(WIDTH) + 31 * np.arange(HEIGHT)[:, None]).astype(np.uint16)
    depth[3], depth[5, 2:9], depth[-1, -1] = 0, 0, 0
    return depth


def metres() -> np.ndarray:
    return millimetres().astype(np.float32) / 1000


def raw(encoding: str, values: np.ndarray, expected: np.ndarray, atol: float = 0.0, *, big: bool = False) -> Encoded:
    """An image message whose rows end with padding that is no part of the picture."""
    ordered = np.ascontiguousarray(values, values.dtype.newbyteorder(">" if big else "<"))
    rows = ordered.view(np.uint8).reshape(HEIGHT, -1)
    padded = np.pad(rows, ((0, 0), (0, PADDING)), constant_values=201)
    fields = {"encoding": encoding, "height": HEIGHT, "width": WIDTH, "step": padded.shape[1], "is_bigendian": int(big), "data": padded.tobytes()}
    return Encoded(IMAGE, fields, expected, atol)


def compressed(format: str, data: bytes, expected: np.ndarray, atol: float = 0.0) -> Encoded:
    return Encoded(COMPRESSED, {"format": format, "data": data}, expected, atol)


def yuv(rgb: np.ndarray) -> np.ndarray:
    """Y, U, V (H, W, 3) uint8 by BT.601, Y in 16 .. 235, U and V in 16 .. 240."""
    r, g, b = np.moveaxis(rgb.astype(float), -1, 0)
    y = 0.299 * r + 0.587 * g + 0.114 * b
    u, v = (b - y) / 1.772, (r - y) / 1.402
    return np.rint(np.stack([16 + y * 219 / 255, 128 + u * 224 / 255, 128 + v * 224 / 255], -1)).astype(np.uint8)


def packed(order: str) -> np.ndarray:
    """The picture as UYVY or YUYV bytes (H, W, 2)."""
    y, u, v = np.moveaxis(yuv(picture()), -1, 0)
    chroma = np.where(np.arange(WIDTH) % 2 == 0, u, v)
    return np.stack([chroma, y] if order == "uyvy" else [y, chroma], -1)


def mosaic(pattern: str, rgb: np.ndarray) -> np.ndarray:
    """What a sensor with a colour filter sees (H, W); the pattern's letters are its upper left 2 x 2 pixels, row by row."""
    result = np.empty((HEIGHT, WIDTH), rgb.dtype)
    for k, letter in enumerate(pattern):
        result[k // 2 :: 2, k % 2 :: 2] = rgb[k // 2 :: 2, k % 2 :: 2, "rgb".index(letter)]
    return result


def flat() -> np.ndarray:
    """A picture of one colour: what a colour filter leaves of it tells all of it."""
    return np.broadcast_to(np.uint8([200, 120, 40]), (HEIGHT, WIDTH, 3))


def grey(values: np.ndarray) -> np.ndarray:
    return np.repeat(values[..., None], 3, 2)


def png(values: np.ndarray) -> bytes:
    return cv2.imencode(".png", values)[1].tobytes()


def rvl(values: np.ndarray) -> bytes:
    """Number by number, as the paper describes it: pieces of three bits, eight of them a word."""
    pieces: list[int] = []

    def number(value: int) -> None:
        while value > 7:
            pieces.append(value & 7 | 8)
            value >>= 3
        pieces.append(value)

    flat, k, before = values.ravel().astype(int).tolist(), 0, 0
    while k < len(flat):
        zeros = next((i for i, value in enumerate(flat[k:]) if value), len(flat) - k)
        k += zeros
        others = next((i for i, value in enumerate(flat[k:]) if not value), len(flat) - k)
        number(zeros)
        number(others)
        for value in flat[k : k + others]:
            step, before = value - before, value
            number(2 * step if step >= 0 else -2 * step - 1)
        k += others
    pieces += [0] * (-len(pieces) % 8)
    words = [sum(piece << 4 * (7 - i) for i, piece in enumerate(pieces[at : at + 8])) for at in range(0, len(pieces), 8)]
    return struct.pack("<iff", 1, 0, 0) + struct.pack("<ii", values.shape[1], values.shape[0]) + struct.pack(f"<{len(words)}I", *words)


def quantised() -> bytes:
    """32FC1 as compressed_depth_image_transport stores it: a / depth + b in whole numbers."""
    a, b = 10_000.0, 1.0
    depth = metres()
    stored = np.where(depth > 0, np.rint(a / np.where(depth > 0, depth, 1) + b), 0).astype(np.uint16)
    return struct.pack("<iff", 0, a, b) + png(stored)


def with_gaps() -> np.ndarray:
    """Depth [m] with NaN, infinity and negative numbers where it is not known."""
    depth = metres()
    depth[3], depth[5, 2:9], depth[-1, -1] = np.nan, np.inf, -1.0
    return depth


ALPHA = np.full((HEIGHT, WIDTH, 1), 9, np.uint8)
COLOUR: dict[str, Callable[[], Encoded]] = {
    "rgb8": lambda: raw("rgb8", picture(), picture()),
    "bgr8": lambda: raw("bgr8", picture()[..., ::-1], picture()),
    "rgba8": lambda: raw("rgba8", np.dstack([picture(), ALPHA]), picture()),
    "bgra8": lambda: raw("bgra8", np.dstack([picture()[..., ::-1], ALPHA]), picture()),
    "mono8": lambda: raw("mono8", picture()[..., 0], grey(picture()[..., 0])),
    "mono16": lambda: raw("mono16", picture()[..., 0] * np.uint16(257), grey(picture()[..., 0])),
    "mono16, big-endian": lambda: raw("mono16", picture()[..., 0] * np.uint16(257), grey(picture()[..., 0]), big=True),
    **{name: lambda name=name: raw(name, packed("uyvy"), picture(), 3) for name in ("yuv422", "uyvy")},
    **{name: lambda name=name: raw(name, packed("yuyv"), picture(), 3) for name in ("yuv422_yuy2", "yuyv")},
    **{f"bayer_{p}8": lambda p=p: raw(f"bayer_{p}8", mosaic(p, flat()), flat()) for p in ("rggb", "bggr", "gbrg", "grbg")},
    **{f"bayer_{p}16": lambda p=p: raw(f"bayer_{p}16", mosaic(p, flat() * np.uint16(257)), flat(), big=p == "gbrg") for p in ("rggb", "bggr", "gbrg", "grbg")},
    "jpeg": lambda: compressed("bgr8; jpeg compressed bgr8", cv2.imencode(".jpg", picture()[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes(), picture(), 12),
    "png": lambda: compressed("rgb8; png compressed bgr8", png(picture()[..., ::-1]), picture()),
}
DEPTH: dict[str, Callable[[], Encoded]] = {
    "16UC1": lambda: raw("16UC1", millimetres(), metres(), 1e-6),
    "16UC1, big-endian": lambda: raw("16UC1", millimetres(), metres(), 1e-6, big=True),
    "mono16": lambda: raw("mono16", millimetres(), metres(), 1e-6),
    "32FC1": lambda: raw("32FC1", with_gaps(), metres()),
    "32FC1, big-endian": lambda: raw("32FC1", with_gaps(), metres(), big=True),
    "compressedDepth, 16UC1": lambda: compressed("16UC1; compressedDepth png", bytes(12) + png(millimetres()), metres(), 1e-6),
    "compressedDepth, 32FC1": lambda: compressed("32FC1; compressedDepth png", quantised(), metres(), 1e-4),
    "compressedDepth, RVL": lambda: compressed("16UC1; compressedDepth rvl", rvl(millimetres()), metres(), 1e-6),
}
