"""Markers: one list of lines or cubes after the deletion of what was shown before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .messages import stamp

DELETE_ALL, ADD, LINE_LIST, CUBE_LIST = 3, 0, 5, 6  # visualization_msgs/msg/Marker
ARROW_COLOR = {"r": 1.0, "g": 0.375, "b": 0.125, "a": 1.0}
WHITE = {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}


def lines(head: Mapping[str, Any], ends: np.ndarray, *, width_m: float) -> dict[str, Any]:
    """MarkerArray of lines (M, 2, 3) [m]."""
    shown = [_marker(head, "force", LINE_LIST, (width_m, 0.0, 0.0), ends.reshape(-1, 3), ARROW_COLOR)] if len(ends) else []
    return {"markers": [_deletion(head, "force"), *shown]}


def cubes(head: Mapping[str, Any], centres: np.ndarray, rgb: np.ndarray, *, edge_m: float) -> dict[str, Any]:
    """MarkerArray of cubes at centres (M, 3) [m] with colours (M, 3), 0..255."""
    colours = [dict(zip("rgba", (*map(float, colour), 1.0), strict=True)) for colour in (rgb / 255).astype(np.float32)]
    shown = [_marker(head, "stiffness", CUBE_LIST, (edge_m,) * 3, centres, WHITE) | {"colors": colours}] if len(centres) else []
    return {"markers": [_deletion(head, "stiffness"), *shown]}


def _deletion(head: Mapping[str, Any], namespace: str) -> dict[str, Any]:
    return _marker(head, namespace, LINE_LIST, (0.0, 0.0, 0.0), np.zeros((0, 3)), WHITE) | {"action": DELETE_ALL}


def _marker(head: Mapping[str, Any], namespace: str, kind: int, scale: tuple[float, ...], points: np.ndarray, color: Mapping[str, float]) -> dict[str, Any]:
    return {
        "header": head,
        "ns": namespace,
        "id": 0,
        "type": kind,
        "action": ADD,
        "pose": {"position": vector(np.zeros(3)), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
        "scale": vector(np.array(scale)),
        "color": color,
        "lifetime": stamp(0),
        "points": [vector(point) for point in points],
    }


def vector(values: np.ndarray) -> dict[str, float]:
    """geometry_msgs/Vector3 or Point of an array (3,)."""
    return dict(zip("xyz", map(float, values), strict=True))
