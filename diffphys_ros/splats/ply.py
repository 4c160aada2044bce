"""Gaussians in the parameterisation and file layout of 3D Gaussian splatting (Kerbl et al. 2023), as viewers read it.

A raw row holds FIELDS: position [m], normal (unused, 0), spherical-harmonic colour of degree 0, logit of the opacity,
logarithms of the standard deviations [m], quaternion wxyz.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from ..errors import InputError, shown
from ..types import Splats

FIELDS = (
    *("x", "y", "z", "nx", "ny", "nz"),
    *("f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
SH_C0 = 0.28209479177387814  # spherical harmonic of degree 0: 1 / (2 sqrt(pi))
MAX_LOGIT = 15.0  # keeps an opacity of 0 or 1 finite
MIN_SCALE_M = 1e-9  # keeps a scale of 0 finite
SCALES_M = 1e-18, 1e6  # of Gaussians that are read: their squares are normal float32 numbers
MAX_EXPONENT = 700.0  # of e, which overflows a little above
MAX_PLACE_M = 1e6  # of a coordinate that is read
MAX_FILE_BYTES = 2**31
MAX_PROPERTIES = 256  # of a vertex that is read; 3DGS with all harmonics has 62
UNIT_TOLERANCE = 1e-6  # quaternions nearer to unit norm are kept as they are, so that reading twice changes nothing

_MEAN, _COLOR, _OPACITY, _SCALE, _ROTATION = slice(0, 3), slice(6, 9), 9, slice(10, 13), slice(13, 17)
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip


def to_raw(splats: Splats) -> np.ndarray:
    """Rows of FIELDS, float32, shape (G, 17)."""
    raw = np.zeros((len(splats.mean), len(FIELDS)), np.float32)
    opacity = splats.opacity.astype(float)
    with np.errstate(divide="ignore"):
        raw[:, _OPACITY] = np.clip(np.log(opacity) - np.log1p(-opacity), -MAX_LOGIT, MAX_LOGIT)
    raw[:, _MEAN], raw[:, _ROTATION] = splats.mean, splats.rotation
    raw[:, _COLOR] = (splats.color.astype(float) - 0.5) / SH_C0
    raw[:, _SCALE] = np.log(np.maximum(splats.scale.astype(float), MIN_SCALE_M))
    return raw


def from_raw(raw: np.ndarray) -> Splats:
    """Splats of rows of FIELDS (G, 17). Colours are clipped to 0..1, quaternions brought to unit norm.

    Raises InputError for a wrong shape, for numbers that are not finite, for quaternions of norm 0 and for positions and scales out of bounds.
    """
    if raw.ndim != 2 or raw.shape[1] != len(FIELDS) or not len(raw):
        raise InputError(f"splats: array of shape {raw.shape} must be (G, {len(FIELDS)}) with the fields {' '.join(FIELDS)} and G > 0")
    with np.errstate(invalid="ignore"):  # of a signalling NaN
        values = raw.astype(float)
    norm = np.linalg.norm(values[:, _ROTATION], axis=1, keepdims=True)
    wrong = ~(np.isfinite(values).all(1) & (norm[:, 0] > 0))
    if wrong.any():
        raise InputError(f"splats: row {int(np.argmax(wrong))} holds a number that is not finite or a quaternion of norm 0; fit them again")
    log_low, log_high = np.log(SCALES_M)
    far = (np.abs(values[:, _MEAN]) > MAX_PLACE_M).any(1) | ((values[:, _SCALE] < log_low) | (values[:, _SCALE] > log_high)).any(1)
    if far.any():
        raise InputError(
            f"splats: row {int(np.argmax(far))} lies beyond {MAX_PLACE_M:g} m or has a scale outside {SCALES_M[0]:g} .. {SCALES_M[1]:g} m; give the scene in metres"
        )
    unit = np.where(np.abs(norm - 1) <= UNIT_TOLERANCE, values[:, _ROTATION], values[:, _ROTATION] / norm)
    fields = (
        values[:, _MEAN],
        unit,
        np.exp(values[:, _SCALE]),
        1 / (1 + np.exp(np.minimum(-values[:, _OPACITY], MAX_EXPONENT))),
        np.clip(values[:, _COLOR] * SH_C0 + 0.5, 0, 1),
    )
    return Splats(*(f.astype(np.float32) for f in fields))


def canonical(splats: Splats) -> Splats:
    """The nearest Splats that survive raw form unchanged: from_raw(to_raw(s)) equals s to the bit, so that those who get
    them from a file or a topic see the same numbers as those who fitted them."""
    while True:
        again = from_raw(to_raw(splats))
        if all(np.array_equal(a, b) for a, b in zip(vars(again).values(), vars(splats).values(), strict=True)):
            return again
        splats = again


def write(path: str | Path, splats: Splats) -> None:
    """Write a binary little-endian .ply; the file appears whole or not at all. Raises InputError where it cannot be written."""
    path, raw = Path(path), to_raw(splats)
    properties = [f"property float {name}" for name in FIELDS]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(raw)}", *properties, "end_header"]
    part = path.with_name(path.name + ".part")
    try:
        part.write_bytes("\n".join([*header, ""]).encode() + raw.astype("<f4").tobytes())
        os.replace(part, path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"splats {shown(path)}: cannot be written ({error.strerror or error}); name a file in a writable folder") from error


def read(path: str | Path) -> Splats:
    """Splats of a binary little-endian .ply; further properties (normals, f_rest_*) are ignored. Raises InputError for a
    file that is missing, truncated, of another format or without a needed property."""
    path = Path(path)
    data = _bytes_of(path)
    count, layout, start = _header(path, data)
    there = (len(data) - start) // layout.itemsize
    if there < count:
        raise InputError(f"splats {shown(path)}: ends after {there} of {count} Gaussians; copy the file again")
    rows = np.frombuffer(data, layout, offset=start, count=count) if count else np.zeros(0, layout)
    raw = np.zeros((count, len(FIELDS)), np.float32)
    with np.errstate(over="ignore", invalid="ignore"):  # of doubles; what is not finite is refused below
        for i, name in enumerate(FIELDS):
            if name in (layout.names or ()):
                raw[:, i] = rows[name]
    try:
        return from_raw(raw)
    except InputError as error:
        raise InputError(f"{shown(path)}: {error}") from error


def _bytes_of(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"splats {shown(path)}: is no regular file; give the path of a .ply file")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise InputError(f"splats {shown(path)}: has over {MAX_FILE_BYTES // 2**20} MiB; export fewer Gaussians")
        return path.read_bytes()
    except InputError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"splats {shown(path)}: {reason}; give the path of a readable .ply file") from error


def _header(path: Path, data: bytes) -> tuple[int, np.dtype, int]:
    """Number of Gaussians, type of a row, offset of the first row."""
    head, end, _ = data.partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii", "replace").splitlines()] if end else []
    if lines[:1] != [["ply"]] or ["format", "binary_little_endian", "1.0"] not in lines:
        raise InputError(f"splats {shown(path)}: is no binary little-endian .ply; export it as one")
    elements = [line for line in lines if line[:1] == ["element"]]
    properties = [line for line in lines if line[:1] == ["property"]]
    if len(elements) != 1 or not re.fullmatch("element vertex [0-9]{1,10}", " ".join(elements[0])):
        raise InputError(f"splats {shown(path)}: must hold one element, the vertices, and their number; export Gaussians, not a mesh")
    names = [line[-1] for line in properties]
    missing = [name for name in FIELDS if name not in names and name not in ("nx", "ny", "nz")]
    if missing or any(len(line) != 3 or line[1] not in _TYPES for line in properties):
        raise InputError(f"splats {shown(path)}: has no {' '.join(missing) or 'plain scalar properties'}; export Gaussians in the 3DGS layout")
    if len(set(names)) < len(names) or len(names) > MAX_PROPERTIES:
        raise InputError(f"splats {shown(path)}: has a property twice or more than {MAX_PROPERTIES}; export Gaussians in the 3DGS layout")
    return int(elements[0][2]), np.dtype([(line[2], "<" + _TYPES[line[1]]) for line in properties]), len(head) + len(end)
