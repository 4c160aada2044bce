"""What compressed_depth_image_transport publishes: 12 bytes of header, then a PNG or RVL.

RVL (Wilson 2017, "Fast lossless depth image compression"): runs of zeros and of others in turn, each told by its length; of the others the
difference to the one before, as zigzag whole numbers. Every number is a row of 4-bit pieces, the lowest three bits first, whose fourth bit
says that another follows; eight pieces a 32-bit word, the first in its highest bits.
"""

from __future__ import annotations

import struct

import numpy as np

from diffphys_ros.errors import InputError, short

HEADER = struct.Struct("<iff")  # format, then the two numbers of the quantisation of 32FC1
RVL_SIZE = struct.Struct("<ii")  # width, height
LONGEST_NUMBER = 11  # pieces of three bits of a number of 32 bits
MARK = "compressedDepth"


def is_compressed_depth(format: str) -> bool:
    """Whether a CompressedImage of this format comes from compressed_depth_image_transport."""
    return MARK in format


def is_rvl(format: str) -> bool:
    """Whether it is RVL rather than PNG."""
    return "rvl" in format.lower()


def rvl_size(format: str, raw: bytes) -> tuple[int, int]:
    """Width and height [px] of an RVL image, at least 1 each. Raises InputError where there are none."""
    if len(raw) < HEADER.size + RVL_SIZE.size:
        raise _no_rvl(format)
    width, height = RVL_SIZE.unpack_from(raw, HEADER.size)
    if width < 1 or height < 1:
        raise _no_rvl(format)
    return width, height


def rvl_values(format: str, raw: bytes) -> np.ndarray:
    """The numbers (H, W) uint16 of an RVL image. Raises InputError where the data is none."""
    width, height = rvl_size(format, raw)
    numbers = _numbers(raw[HEADER.size + RVL_SIZE.size :])
    runs = _runs(numbers, width * height)
    if runs is None:
        raise _no_rvl(format)
    result = np.zeros(width * height, np.int64)
    steps = np.concatenate([numbers[at : at + count] for at, _, count in runs] or [numbers[:0]])
    values = np.cumsum((steps >> 1) ^ -(steps & 1))  # over all runs: the zeros between them change nothing
    done = 0
    for _, first, count in runs:
        result[first : first + count] = values[done : done + count]
        done += count
    if result.min() < 0 or result.max() > np.iinfo(np.uint16).max:
        raise _no_rvl(format)
    return result.astype(np.uint16).reshape(height, width)


def dequantised(format: str, raw: bytes, picture: np.ndarray) -> np.ndarray:
    """Depth [m] (H, W) of a quantised inverse depth: a / (value - b), NaN where the value is 0."""
    _, a, b = HEADER.unpack_from(raw)
    with np.errstate(all="ignore"):  # what is no number is unknown depth
        return np.where(picture > 0, np.float32(a) / (picture.astype(np.float32) - np.float32(b)), np.float32(np.nan))


def _numbers(data: bytes) -> np.ndarray:
    """The whole numbers (N,) int64 that rows of 4-bit pieces stand for."""
    words = np.frombuffer(data[: len(data) // 4 * 4], "<u4").astype(">u4").view(np.uint8)
    pieces = np.stack([words >> 4, words & 15], -1).ravel().astype(np.int64)
    last = np.flatnonzero(pieces < 8)
    first = np.concatenate([[0], last[:-1] + 1])
    place = np.arange(last[-1] + 1 if len(last) else 0) - np.repeat(first, last - first + 1) if len(last) else np.zeros(0, np.int64)
    shifted = np.where(place < LONGEST_NUMBER, (pieces[: len(place)] & 7) << (3 * np.minimum(place, LONGEST_NUMBER)), 0)
    return np.add.reduceat(shifted, first) if len(last) else shifted


def _runs(numbers: np.ndarray, pixels: int) -> list[tuple[int, int, int]] | None:
    """(index of the first number, first pixel, count) of every run of pixels with depth; None where they do not make up the picture."""
    runs, at, done = [], 0, 0
    while done < pixels:
        if at + 2 > len(numbers):
            return None
        zeros, count = int(numbers[at]), int(numbers[at + 1])
        at, done = at + 2, done + zeros
        if not zeros + count or done + count > pixels or at + count > len(numbers):
            return None
        runs.append((at, done, count))
        at, done = at + count, done + count
    return runs


def _no_rvl(format: str) -> InputError:
    return InputError(f"depth image with format {short(format)} holds no RVL that can be decoded; set the transport's compressedDepth format to png")
