"""PointCloud2 layouts: field names, types and units, and packing between numpy and bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError

_DATATYPE = {"u4": 6, "f4": 7}  # sensor_msgs/msg/PointField
_KIND = {code: kind for kind, code in _DATATYPE.items()}

# Field -> unit, in the order of the bytes; uint32 where the unit is "#".
MATERIAL = {
    "x": "m", "y": "m", "z": "m", "young_modulus": "Pa", "poisson_ratio": "", "density": "kg/m^3", "volume": "m^3",
    "log10_young_sd": "", "intensity": "log10 Pa", "id": "#", "part": "#",
}  # fmt: skip
FORCE = {"x": "m", "y": "m", "z": "m", "t": "s", "fx": "N/m^3", "fy": "N/m^3", "fz": "N/m^3", "volume": "m^3", "id": "#"}
STATE = {"x": "m", "y": "m", "z": "m", "id": "#", "fx": "N/m^3", "fy": "N/m^3", "fz": "N/m^3", "intensity": "log10 Pa"}


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


def unpack(cloud: Any) -> np.ndarray:
    """Structured array (height, width) of a PointCloud2, plain or rclpy; honours offsets, steps and byte order.

    Raises InputError for fields that are neither float32 nor uint32 and for data of the wrong size.
    """

    def get(name: str) -> Any:
        return cloud[name] if isinstance(cloud, Mapping) else getattr(cloud, name)

    fields = [f if isinstance(f, Mapping) else {n: getattr(f, n) for n in ("name", "offset", "datatype")} for f in get("fields")]
    unknown = [f["name"] for f in fields if f["datatype"] not in _KIND]
    if unknown:
        raise InputError(f"point cloud: field {unknown[0]!r} is neither float32 nor uint32; publish it as one of these")
    height, width, data = get("height"), get("width"), bytes(get("data"))
    if len(data) != get("row_step") * height or get("row_step") < width * get("point_step"):
        raise InputError(f"point cloud: {len(data)} bytes do not hold {height} x {width} points of {get('point_step')} bytes; correct the steps")
    order = ">" if get("is_bigendian") else "<"
    record = np.dtype({
        "names": [f["name"] for f in fields], "formats": [order + _KIND[f["datatype"]] for f in fields],
        "offsets": [f["offset"] for f in fields], "itemsize": get("point_step"),
    })  # fmt: skip
    return np.ndarray((height, width), record, data, strides=(get("row_step"), get("point_step")))


def xyz(points: np.ndarray, prefix: str = "") -> np.ndarray:
    """Fields x y z (or fx fy fz with prefix "f") of a structured array (...) as float64 (..., 3)."""
    return np.stack([points[prefix + axis].astype(float) for axis in "xyz"], -1)
