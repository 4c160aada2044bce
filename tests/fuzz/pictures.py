"""Hostile pictures and Gaussians: raw and compressed image messages, compressed depth, .ply files."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from diffphys_ros.bags.decode import MAX_PIXELS, decode_compressed, decode_image
from diffphys_ros.bags.encodings import CHANNELS, DEPTH, WIDE
from diffphys_ros.errors import InputError
from diffphys_ros.splats import ply
from diffphys_ros.types import Splats

COUNT = 20_000
HEIGHT, WIDTH, GAUSSIANS = 16, 24, 12
SIZES = (0, 1, 2, 3, 7, 16, 24, 65535, 2**15, 30_000, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-45, 1e-38, 1e38, -1e38, 200.0, -200.0, 88.0, np.nan, np.inf, -np.inf)
ENCODINGS = (*CHANNELS, *WIDE, *DEPTH, "", "nv21", "rgb8\0", "RGB8", "é" * 40, "x" * 5000, "rgb8\n", "64FC1")
FORMATS = ("jpeg", "png", "rgb8; jpeg compressed bgr8", "16UC1; png compressed", "", "\n", "x" * 5000, "tiff", "\0")
DEPTH_FORMATS = ("16UC1; compressedDepth png", "32FC1; compressedDepth png", " 32FC1; compressedDepth", "compressedDepth", "16UC1; compressedDepth rvl")
HEADER_WORDS = (
    "element vertex", "element vertex -1", "element vertex 99999999999", "element vertex " + "9" * 5000, "element vertex 0", "element vertex 1e3",
    "element face 4", "element", "property", "property float", "property float x", "property list uchar int x", "property double y", "property float \xb2",
    "property float 32 x", "property int64 x", "format ascii 1.0", "format binary_big_endian 1.0", "comment " + "c" * 3000, "end_header", "ply", "", "\0",
)  # fmt: skip


def case(seed: int, folder: Path) -> str:
    """One hostile picture or file of Gaussians."""
    rng = np.random.default_rng(seed)
    kinds: list[Callable[[np.random.Generator, Path], None]] = [_raw, _raw, _compressed, _compressed, _depth, _gaussians, _gaussians, _rows]
    try:
        kinds[int(rng.integers(len(kinds)))](rng, folder)
    except InputError as error:
        text = str(error)
        assert 0 < len(text) < 600, text[:700]
        assert text.isprintable(), repr(text)
        return "refused"
    return "taken"


def pick(rng: np.random.Generator, some: Any) -> Any:
    """One of a sequence."""
    return some[int(rng.integers(len(some)))]


def spoiled(rng: np.random.Generator, data: bytes) -> bytes:
    """Bytes cut, flipped, doubled, or left alone."""
    how, data = int(rng.integers(6)), bytearray(data)
    if how == 0:
        return bytes(data[: int(rng.integers(len(data) + 1))])
    if how == 1:
        for at in rng.integers(0, len(data), int(rng.integers(1, 9))):
            data[at] ^= 1 << int(rng.integers(8))
    elif how == 2:
        at = int(rng.integers(len(data)))
        data[at : at + 4] = rng.bytes(4)
    elif how == 3:
        at = int(rng.integers(len(data)))
        data[at:at] = data[: int(rng.integers(len(data)))]
    elif how == 4:
        at = int(rng.integers(max(len(data) - 4, 1)))
        data[at : at + 4] = pick(rng, (b"\xff\xff\xff\xff", bytes(4), b"\x7f\xff\xff\xff", b"\x80\0\0\0"))
    return bytes(data)


def image_fields(rng: np.random.Generator) -> dict[str, Any]:
    """Fields of a sensor_msgs/Image: a valid one, with some that do not fit."""
    encoding = pick(rng, [*CHANNELS, *WIDE, *DEPTH])
    row = WIDTH * CHANNELS.get(encoding, np.dtype((WIDE | DEPTH).get(encoding, np.uint8)).itemsize)
    step = row + int(rng.integers(3)) * 4
    fields: dict[str, Any] = {"encoding": encoding, "height": HEIGHT, "width": WIDTH, "step": step, "is_bigendian": int(rng.integers(2))}
    fields["data"] = rng.bytes(step * HEIGHT)
    for name in ("encoding", "height", "width", "step", "data"):
        if rng.random() < 0.12:
            fields[name] = {"encoding": lambda: pick(rng, ENCODINGS), "data": lambda: rng.bytes(int(rng.integers(2 * step * HEIGHT)))}.get(
                name, lambda: int(pick(rng, SIZES))
            )()
    return fields


def _raw(rng: np.random.Generator, _: Path) -> None:
    fields = image_fields(rng)
    data = fields["data"]
    image = decode_image(**fields | {"data": pick(rng, (data, np.frombuffer(data, np.uint8), bytearray(data)))}, colour=bool(rng.integers(2)))
    _check(image)
    assert image.shape[:2] == (fields["height"], fields["width"])


@lru_cache
def _pictures() -> tuple[bytes, ...]:
    rng = np.random.default_rng(0)
    colour, deep = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8), rng.integers(0, 65536, (HEIGHT, WIDTH)).astype(np.uint16)
    kinds = [(".png", colour), (".jpg", colour), (".png", deep), (".png", colour[..., 0]), (".jpg", colour[..., 0]), (".png", np.dstack([colour, colour[..., :1]]))]
    kinds += [(".png", np.dstack([deep] * 3)), (".bmp", colour), (".pgm", colour[..., 0]), (".tiff", deep.astype(np.float32)), (".webp", colour), (".ppm", colour)]
    progressive = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    return (*(cv2.imencode(suffix, pixels)[1].tobytes() for suffix, pixels in kinds), progressive)


def _declared(rng: np.random.Generator, data: bytes) -> bytes:
    """The picture with another size in its header, checksums put right."""
    width, height = (int(pick(rng, (0, 1, 23, 24, 300, 4000, 30_000, 65535))) for _ in range(2))
    if data.startswith(b"\x89PNG"):
        chunk = b"IHDR" + struct.pack(">II", width * int(pick(rng, (1, 1, 1, 2**15))), height) + data[24:29]
        return data[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
    at = next((i for i in range(len(data) - 8) if data[i] == 0xFF and data[i + 1] in (0xC0, 0xC2)), -1)
    return data if at < 0 else data[: at + 5] + struct.pack(">HH", height, width) + data[at + 9 :]


def picture(rng: np.random.Generator) -> bytes:
    """A picture file, often spoiled."""
    data = pick(rng, _pictures())
    if rng.random() < 0.3:
        data = _declared(rng, data)
    return spoiled(rng, data) if rng.random() < 0.6 else data


def _compressed(rng: np.random.Generator, _: Path) -> None:
    _check(decode_compressed(pick(rng, FORMATS), picture(rng), colour=bool(rng.integers(2))))


def _depth(rng: np.random.Generator, _: Path) -> None:
    quantised = struct.pack("<iff", 0, *(float(np.float32(pick(rng, (*NUMBERS, 100.0)))) for _ in range(2)))
    data = quantised[: int(pick(rng, (0, 3, 12, 12, 12)))] + (_pictures()[2] if rng.random() < 0.4 else picture(rng))
    if rng.random() < 0.2:
        data = spoiled(rng, struct.pack("<iffii", 1, 0.0, 0.0, WIDTH, HEIGHT) + rng.bytes(int(rng.integers(4 * WIDTH * HEIGHT))))
    image = decode_compressed(pick(rng, DEPTH_FORMATS), data)
    assert image.ndim == 2
    _check(image)


def _check(image: np.ndarray) -> None:
    assert 0 < image.shape[0] * image.shape[1] <= MAX_PIXELS
    if image.ndim == 3:
        assert (image.dtype, image.shape[2]) == (np.uint8, 3)
    else:
        assert (image.dtype, image.ndim) == (np.float32, 2)
        assert np.isfinite(image).all()
        assert (image >= 0).all()


@lru_cache
def raw_rows() -> np.ndarray:
    """Valid rows of ply.FIELDS."""
    rng = np.random.default_rng(1)
    return rng.normal(size=(GAUSSIANS, len(ply.FIELDS))).astype(np.float32)


def hostile_rows(rng: np.random.Generator) -> np.ndarray:
    """Rows with a few numbers that may be none."""
    rows = raw_rows().copy()
    for _ in range(int(rng.integers(4))):
        rows[int(rng.integers(len(rows))), int(rng.integers(rows.shape[1]))] = pick(rng, NUMBERS)
    if rng.random() < 0.1:
        rows[int(rng.integers(len(rows))), 13:] = pick(rng, (0.0, 1e-45, 1e38))
    return rows


def check_splats(splats: Splats) -> None:
    """That Gaussians are finite, of unit quaternions and within bounds."""
    assert all(np.isfinite(field).all() for field in vars(splats).values())
    np.testing.assert_allclose(np.linalg.norm(splats.rotation.astype(float), axis=1), 1, atol=1e-5)
    assert (splats.scale > 0).all()
    assert np.isfinite(np.square(splats.scale) + np.square(splats.mean)).all()
    assert ((splats.opacity >= 0) & (splats.opacity <= 1) & ((splats.color >= 0) & (splats.color <= 1)).all(1)).all()


def _rows(rng: np.random.Generator, _: Path) -> None:
    rows = hostile_rows(rng)
    rows = pick(rng, (rows, rows, rows, rows[:0], rows[:, :5], rows[0]))
    check_splats(ply.from_raw(rows))


def _gaussians(rng: np.random.Generator, folder: Path) -> None:
    kind = pick(rng, ("<f4", "<f4", "<f4", "<f8"))
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {int(pick(rng, (GAUSSIANS, GAUSSIANS, GAUSSIANS, 1, 99)))}"]
    lines += [f"property {'float' if kind == '<f4' else 'double'} {name}" for name in ply.FIELDS] + ["end_header"]
    for _ in range(int(rng.integers(3))):
        at, word = int(rng.integers(len(lines))), pick(rng, HEADER_WORDS)
        lines[at : at + int(rng.integers(2))] = [word] if rng.random() < 0.8 else [lines[at]] * 2
    rows = hostile_rows(rng).astype(kind)
    if kind == "<f8" and rng.random() < 0.3:
        rows[0, int(rng.integers(17))] = 1e300
    data = "\n".join([*lines, ""]).encode() + rows.tobytes()
    path = folder / pick(rng, ("a.ply", "ü b.ply", "folder", "none.ply", "\0.ply", "n" * 300))
    if path.name in ("a.ply", "ü b.ply"):
        path.write_bytes(spoiled(rng, data) if rng.random() < 0.4 else data)
    elif path.name == "folder":
        path.mkdir()
    check_splats(ply.read(path))
