"""PointCloud2 layouts: field names, types and units, and packing between numpy and bytes."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..errors import InputError, short

_DATATYPE = {"u4": 6, "f4": 7}  # sensor_msgs/msg/PointField
_KIND = {code: kind for kind, code in _DATATYPE.items()}
_BYTES = 4  # of either
MAX_FIELDS = 256  # of a cloud that is read; 3DGS with all harmonics has 62

# Field -> unit, in the order of the bytes; uint32 where the unit is "#". Subscribers rely on names, types and places: a later version
# only adds fields, at the end.
MATERIAL = {
    "x": "m", "y": "m", "z": "m", "young_modulus": "Pa", "log10_young_sd": "", "young_lower": "Pa", "poisson_ratio": "", "density": "kg/m^3",
    "volume": "m^3", "part": "#", "identified": "#", "absolute": "#", "intensity": "log10 Pa", "id": "#",
    "young_over_density": "m^2/s^2", "log10_young_over_density_sd": "", "poisson_sd": "", "density_sd": "kg/m^3", "poisson_assumed": "#", "density_assumed": "#", "young_relative": "",
}  # fmt: skip
FORCE = {"x": "m", "y": "m", "z": "m", "t": "s", "fx": "N/m^3", "fy": "N/m^3", "fz": "N/m^3", "volume": "m^3", "intensity": "N/m^3", "id": "#"}
RELATIVE = {"rx": "", "ry": "", "rz": ""}
FIELD = FORCE | {"ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2"} | RELATIVE
STATE = {"x": "m", "y": "m", "z": "m", "fx": "N/m^3", "fy": "N/m^3", "fz": "N/m^3", "intensity": "N/m^3", "id": "#"} | RELATIVE
LAYOUTS = {"~/material_field": MATERIAL, "~/force_field": FIELD, "~/force_so_far": FIELD, "~/state": STATE}
MEANING = {
    "x": "place: at rest, in ~/force_field and ~/state in that frame",
    "young_modulus": "NaN where the part is not identified, and where `absolute` is 0",
    "log10_young_sd": "one standard deviation of log10 of the modulus",
    "young_lower": "the least modulus with 95 %, where that is all that is known; NaN elsewhere, and where `absolute` is 0",
    "volume": "of the particle, or of the cluster that it stands for",
    "part": "1 at the clamp",
    "identified": "1 where the stiffness of the part is identified, else 0",
    "absolute": "1 where the scale is told or measured, or publish.allow_assumed_scale is set; 0 where a density or a size is assumed: E and force are relative then",
    "intensity": "for viewers: log10 of the modulus that was used, or of young_relative; in the others the size of the force density, or of rx, ry, rz",
    "id": "index into the arrays of recovery.npz",
    "t": "after the header's stamp",
    "fx": "force density, per rest volume; NaN where `absolute` is 0",
    "young_over_density": "NaN where the part is not identified, and where no length is known; known whatever the mass is",
    "log10_young_over_density_sd": "one standard deviation of its log10; smaller than that of the modulus where the part swings on its own weight",
    "poisson_sd": "one standard deviation; 0 where it was told",
    "density_sd": "one standard deviation; 0 where it was told",
    "poisson_assumed": "1 where nobody told Poisson's ratio of the part: it is what the free motion made of 0.3, or of the prior's",
    "density_assumed": "1 where nobody told the density of the part; where only the mass of all is told, parts are assumed to be alike",
    "young_relative": "modulus over that of the stiffest part that is identified; known whatever mass and size are",
    "ax": "force over mass, known whatever the mass is; NaN where no length is known",
    "rx": "force density over the largest of the clip; known whatever mass and size are",
}
FINITE = ("x", "y", "z", "t", "rx", "ry", "rz", "volume", "density", "poisson_ratio", "poisson_sd", "density_sd")  # what is known of every particle, whatever is identified


def dtype(layout: Mapping[str, str]) -> np.dtype:
    """The packed record of a layout, little endian."""
    return np.dtype([(name, "<u4" if unit == "#" else "<f4") for name, unit in layout.items()])


def pack(header: Mapping[str, Any], layout: Mapping[str, str], columns: Mapping[str, np.ndarray], shape: tuple[int, int]) -> dict[str, Any]:
    """A plain PointCloud2 of `shape` (height, width); every column broadcasts to it."""
    record = dtype(layout)
    points = np.empty(shape, record)
    for name in layout:
        points[name] = columns[name]
    dense = all(np.isfinite(points[name]).all() for name in layout if record[name].kind == "f")
    return {
        "header": header,
        "height": shape[0],
        "width": shape[1],
        "fields": [
            {"name": name, "offset": int(record.fields[name][1]), "datatype": _DATATYPE[record[name].str[1:]], "count": 1}  # type: ignore[index]
            for name in layout
        ],
        "is_bigendian": False,
        "point_step": record.itemsize,
        "row_step": record.itemsize * shape[1],
        "data": points.tobytes(),
        "is_dense": bool(dense),
    }


def unpack(cloud: Any, needed: Iterable[str] = ()) -> np.ndarray:
    """Structured array (height, width) of a PointCloud2, plain or rclpy; honours offsets, steps and byte order.

    Raises InputError for fields that are neither float32 nor uint32, that are named twice or lie beyond a point, for a cloud that lacks
    one of the `needed` ones or every point, and for data of the wrong size.
    """
    fields = [(_get(f, "name"), _get(f, "offset"), _get(f, "datatype"), _get(f, "count")) for f in _listed(cloud)]
    height, width, step, row_step = (_size(cloud, name) for name in ("height", "width", "point_step", "row_step"))
    _check_fields(fields, step, needed)
    data = _get(cloud, "data")
    if not height * width:
        raise InputError(f"point cloud: {height} x {width} points, at least one is needed; publish it when there is something to show")
    if not isinstance(data, (bytes, bytearray, array, np.ndarray)) or len(data) != row_step * height or row_step < width * step:
        size = len(data) if hasattr(data, "__len__") else 0
        raise InputError(f"point cloud: {size} bytes do not hold {height} x {width} points of {step} bytes; correct the steps")
    order = ">" if _get(cloud, "is_bigendian") else "<"
    record = np.dtype({
        "names": [name for name, *_ in fields], "formats": [order + _KIND[kind] for _, _, kind, _ in fields],
        "offsets": [offset for _, offset, *_ in fields], "itemsize": step,
    })  # fmt: skip
    return np.ndarray((height, width), record, bytes(data), strides=(row_step, step))


def _check_fields(fields: list[tuple[Any, Any, Any, Any]], step: int, needed: Iterable[str]) -> None:
    if not 0 < len(fields) <= MAX_FIELDS:
        raise InputError(f"point cloud: has {'no field' if not fields else f'over {MAX_FIELDS} fields'}, must have 1 to {MAX_FIELDS}; publish the ones that are read")
    seen = set[str]()
    for name, offset, kind, count in fields:
        if not isinstance(name, str) or not name or name in seen:
            raise InputError(f"point cloud: a field is called {short(name)}, each needs a name of its own; rename it")
        if type(kind) is not int or kind not in _KIND:
            raise InputError(f"point cloud: field {short(name)} is neither float32 nor uint32; publish it as one of these")
        if type(offset) is not int or offset < 0 or offset + _BYTES > step or count not in (None, 1):
            raise InputError(
                f"point cloud: field {short(name)} has offset {short(offset)} and count {short(count)}, must be one value within the {step} bytes of a point; correct the field"
            )
        seen.add(name)
    missing = [name for name in needed if name not in seen]
    if missing:
        raise InputError(f"point cloud: has no field {missing[0]!r}; publish all of {', '.join(needed)}")


def _size(cloud: Any, name: str) -> int:
    value = _get(cloud, name)
    if type(value) is not int or not 0 <= value < 2**32:
        raise InputError(f"point cloud: {name} is {short(value)}, must be a number in 0 .. {2**32 - 1}; correct the publisher")
    return value


def _listed(cloud: Any) -> list[Any]:
    fields = _get(cloud, "fields")
    return list(fields[: MAX_FIELDS + 1]) if isinstance(fields, (list, tuple)) else []


def _get(message: Any, name: str) -> Any:
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def particles(cloud: Any, layout: Mapping[str, str]) -> np.ndarray:
    """Structured array (height, width) of a PointCloud2 of a layout. Raises InputError as `unpack`, and where a field of FINITE is not finite."""
    rows = unpack(cloud, layout)
    wrong = next((name for name in layout if name in FINITE and not np.isfinite(rows[name]).all()), None)
    if wrong:
        raise InputError(f"point cloud: field {wrong!r} holds a number that is not finite; publish particles that have a place, a size and a force")
    return rows


def xyz(points: np.ndarray, prefix: str = "") -> np.ndarray:
    """Fields x y z (or fx fy fz with prefix "f") of a structured array (...) as float64 (..., 3)."""
    return np.stack([points[prefix + axis].astype(float) for axis in "xyz"], -1)


def known_force(rows: np.ndarray) -> tuple[np.ndarray, str, str]:
    """What is known of the force in rows of FIELD (T, K), as densities (T, K, 3) that a sum of density * volume makes a net one of, with its name and
    unit: in newtons, else over the largest of the clip."""
    force = xyz(rows, "f")
    return (force, "force", "N") if np.isfinite(force).all() else (xyz(rows, "r"), "force, relative", "")
