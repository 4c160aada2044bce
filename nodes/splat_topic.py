"""Static Gaussians as a PointCloud2 whose fields are named as in a 3DGS .ply file."""

from __future__ import annotations

from typing import Any

import numpy as np

from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import clouds
from diffphys_ros.splats.ply import FIELDS, from_raw, to_raw
from diffphys_ros.types import Splats

LAYOUT = dict.fromkeys(FIELDS, "")  # all float32


def splat_cloud(splats: Splats, header: dict[str, Any]) -> dict[str, Any]:
    """A plain PointCloud2; splats_of gives the very same Splats back."""
    raw = to_raw(splats)
    return clouds.pack(header, LAYOUT, dict(zip(FIELDS, raw.T, strict=True)), (1, len(raw)))


def splats_of(cloud: Any) -> Splats:
    """The Splats of a PointCloud2. Raises InputError where it holds none."""
    try:
        points = clouds.unpack(cloud, LAYOUT).ravel()
        return from_raw(np.stack([points[name] for name in FIELDS], -1))
    except InputError as error:
        raise InputError(f"topic splats: {error}") from error
