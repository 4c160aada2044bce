"""Image messages to arrays."""

from __future__ import annotations

import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from diffphys_ros.bags.decode import decode_compressed, decode_image, is_depth
from diffphys_ros.errors import InputError

RGB = np.random.default_rng(0).integers(0, 255, (5, 7, 3)).astype(np.uint8)
ALPHA = np.full((5, 7, 1), 9, np.uint8)
STORED = {
    "rgb8": RGB,
    "bgr8": RGB[..., ::-1],
    "rgba8": np.concatenate([RGB, ALPHA], 2),
    "bgra8": np.concatenate([RGB[..., ::-1], ALPHA], 2),
}


@pytest.mark.parametrize("encoding", STORED)
def test_every_colour_encoding_comes_out_as_rgb(encoding: str) -> None:
    stored = np.ascontiguousarray(STORED[encoding])
    np.testing.assert_array_equal(decode_image(encoding, 5, 7, stored.strides[0], 0, stored.tobytes()), RGB)


def test_mono8_repeats_its_channel() -> None:
    gray = np.ascontiguousarray(RGB[..., 0])
    np.testing.assert_array_equal(decode_image("mono8", 5, 7, 7, 0, gray.tobytes()), np.repeat(gray[..., None], 3, 2))


def test_padding_at_the_end_of_rows_is_left_out() -> None:
    padded = np.pad(RGB.reshape(5, 21), ((0, 0), (0, 11)), constant_values=77)
    np.testing.assert_array_equal(decode_image("rgb8", 5, 7, 32, 0, padded.tobytes()), RGB)


@pytest.mark.parametrize(("order", "bigendian"), [("<", 0), (">", 1)])
def test_depth_in_millimetres_comes_out_in_metres_in_either_byte_order(order: str, bigendian: int) -> None:
    stored = np.array([[0, 1500], [65535, 1]], order + "u2")
    depth = decode_image("16UC1", 2, 2, 4, bigendian, stored.tobytes())
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, [[0, 1.5], [65.535, 0.001]], rtol=1e-6)


def test_unknown_depth_is_zero_whatever_stands_for_it() -> None:
    stored = np.array([[np.nan, np.inf], [-1.0, 0.75]], np.float32)
    np.testing.assert_array_equal(decode_image("32FC1", 2, 2, 8, 0, stored.tobytes()), np.float32([[0, 0], [0, 0.75]]))


def test_an_unknown_encoding_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'nv21' is unknown; convert to rgb8.*16UC1"):
        decode_image("nv21", 2, 2, 4, 0, bytes(8))
    assert is_depth("nv21") is None


@pytest.mark.parametrize(("size", "step"), [(104, 21), (105, 20), (0, 21)])
def test_an_image_with_fewer_bytes_than_its_rows_need_is_refused(size: int, step: int) -> None:
    with pytest.raises(InputError, match="need more"):
        decode_image("rgb8", 5, 7, step, 0, bytes(size))


@pytest.mark.parametrize("format", ["png", "rgb8; png compressed bgr8"])
def test_png_comes_out_as_rgb_without_loss(format: str) -> None:
    png = cv2.imencode(".png", RGB[..., ::-1])[1].tobytes()
    np.testing.assert_array_equal(decode_compressed(format, png), RGB)


def test_jpeg_keeps_its_channels_in_order() -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 200
    decoded = decode_compressed("jpeg", cv2.imencode(".jpg", red[..., ::-1])[1].tobytes())
    np.testing.assert_allclose(decoded.mean((0, 1)), [200, 0, 0], atol=4)


def test_a_16_bit_png_is_depth_in_millimetres() -> None:
    png = cv2.imencode(".png", np.array([[1000, 0]], np.uint16))[1].tobytes()
    np.testing.assert_allclose(decode_compressed("16UC1; png compressed", png), [[1.0, 0.0]])


def test_compressed_depth_of_16uc1_skips_the_transports_header() -> None:
    png = cv2.imencode(".png", np.array([[1234, 0]], np.uint16))[1].tobytes()
    np.testing.assert_allclose(decode_compressed("16UC1; compressedDepth png", bytes(12) + png), [[1.234, 0.0]])


def test_compressed_depth_of_32fc1_is_the_inverse_of_its_quantisation() -> None:
    a, b = 100.0, 1.0  # as compressed_depth_image_transport: stored = a / depth + b
    true = np.array([[0.5, 2.0]])
    stored = np.append(np.rint(a / true + b), [[0]], 1).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + cv2.imencode(".png", stored)[1].tobytes()
    np.testing.assert_allclose(decode_compressed("32FC1; compressedDepth", data), [[0.5, 2.0, 0.0]], rtol=0.02)


@pytest.mark.parametrize(("format", "data"), [("jpeg", b"no picture"), ("png", b""), ("16UC1; compressedDepth rvl", bytes(40))])
def test_data_that_is_no_picture_is_refused_with_its_format(format: str, data: bytes) -> None:
    with pytest.raises(InputError, match=repr(format)[1:-1]):
        decode_compressed(format, data)


def test_a_step_of_gigabytes_allocates_nothing() -> None:
    tracemalloc.start()
    assert decode_image("rgb8", 1, 1, 2**31, 0, bytes(3)).shape == (1, 1, 3)
    with pytest.raises(InputError, match="need more"):
        decode_image("rgb8", 2, 1, 2**31, 0, bytes(6))
    with pytest.raises(InputError, match="at most 33554432 pixels"):
        decode_image("mono8", 2**16, 2**16, 0, 0, bytes(6))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


def test_the_last_row_may_lack_its_padding() -> None:
    padded = np.pad(RGB.reshape(5, 21), ((0, 0), (0, 11)), constant_values=77)
    np.testing.assert_array_equal(decode_image("rgb8", 5, 7, 32, 0, padded.tobytes()[:-11]), RGB)
    depth = np.pad(np.arange(6, dtype="<u2").reshape(2, 3).view(np.uint8), ((0, 0), (0, 5)))
    np.testing.assert_allclose(decode_image("16UC1", 2, 3, 11, 0, depth.tobytes()[:-5]), [[0, 0.001, 0.002], [0.003, 0.004, 0.005]], rtol=1e-6)


def declaring(suffix: str, width: int, height: int) -> bytes:
    """A picture whose header names another size."""
    data = cv2.imencode(suffix, RGB)[1].tobytes()
    if suffix == ".png":
        chunk = b"IHDR" + struct.pack(">II", width, height) + data[24:29]
        return data[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
    if suffix == ".jpg":
        at = data.index(b"\xff\xc0")
        return data[: at + 5] + struct.pack(">HH", height, width) + data[at + 9 :]
    if suffix == ".bmp":
        return data[:18] + struct.pack("<ii", width, height) + data[26:]
    return f"P6 {width} {height} 255 ".encode() + data


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".ppm"])
def test_a_picture_that_claims_to_be_huge_is_refused_before_it_is_decoded(suffix: str) -> None:
    with pytest.raises(InputError, match=r"at most 33554432 pixels|cannot be decoded") as caught:
        decode_compressed("jpeg", declaring(suffix, 30_000, 30_000))
    assert suffix in (".bmp", ".ppm") or "30000x30000 px" in str(caught.value)


def test_a_jpeg_of_endless_scans_is_refused() -> None:
    data = cv2.imencode(".jpg", RGB, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    assert decode_compressed("jpeg", data).shape == RGB.shape
    scan = data[data.index(b"\xff\xda") : data.index(b"\xff\xda", data.index(b"\xff\xda") + 2)]
    with pytest.raises(InputError, match="cannot be decoded"):
        decode_compressed("jpeg", data[:-2] + 200 * scan + data[-2:])


def test_compressed_depth_of_colours_is_refused() -> None:
    png = cv2.imencode(".png", RGB)[1].tobytes()
    with pytest.raises(InputError, match="one channel of 16 bits"):
        decode_compressed("32FC1; compressedDepth png", bytes(12) + png)


def test_an_encoding_of_thousands_of_characters_is_not_printed_whole() -> None:
    with pytest.raises(InputError) as caught:
        decode_image("x" * 5000, 2, 2, 4, 0, bytes(8))
    assert len(str(caught.value)) < 300
