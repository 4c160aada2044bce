"""Static Gaussians as a PointCloud2 whose fields are named as in a 3DGS .ply file."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import clouds
from diffphys_ros.splats.ply import FIELDS, from_raw, to_raw
from diffphys_ros.types import Splats

FLOATS = dict.fromkeys(FIELDS, "")
LABELS = "labels"
LAYOUT = FLOATS | {LABELS: "#"}


def splat_cloud(splats: Splats, header: dict[str, Any], labels_crc: int) -> dict[str, Any]:
    """A plain PointCloud2; splats_of gives the very same Splats back. `labels_crc`: of the mask of frame 0 that they were fitted in."""
    raw = to_raw(splats)
    columns = dict(zip(FIELDS, raw.T, strict=True)) | {LABELS: np.full(len(raw), labels_crc, np.uint32)}
    return clouds.pack(header, LAYOUT, columns, (1, len(raw)))


def labels_crc_of(cloud: Any) -> int | None:
    """CRC-32 of the mask that the Gaussians of a PointCloud2 were fitted in; None where it does not say."""
    points = clouds.unpack(cloud).ravel()
    if LABELS not in points.dtype.names or points.dtype[LABELS].kind != "u":
        return None
    return int(points[LABELS][0])


def splats_of(cloud: Any) -> Splats:
    """The Splats of a PointCloud2. Raises InputError where it holds none."""
    try:
        points = clouds.unpack(cloud, FLOATS).ravel()
        return from_raw(np.stack([points[name] for name in FIELDS], -1))
    except InputError as error:
        raise InputError(f"topic splats: {error}") from error
