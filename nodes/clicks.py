"""What a person clicks in frame 0: points as viewers send them, and lines by their two ends, one click after the other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError, short
from diffphys_ros.types import Camera

POINT = "geometry_msgs/msg/PointStamped"
CLAMP_CLICK, LENGTH_CLICK = "clamp_click", "length_click"
LINES = {CLAMP_CLICK: "clamp_px", LENGTH_CLICK: "length_px"}  # by topic, what of `scene` it draws


def place_of(click: Any, topic: str) -> np.ndarray:
    """The point of a geometry_msgs/PointStamped (3,). Raises InputError where it is not finite."""
    point = np.array([click.point.x, click.point.y, click.point.z])
    if not np.isfinite(point).all():
        raise InputError(f"topic {topic}: the point {point.tolist()} is not finite, must be a pixel or a place in m; click on the object")
    return point


def pixel_of(click: Any, camera: Camera, topic: str) -> np.ndarray:
    """Where a geometry_msgs/PointStamped lies in the image (2,) [px].

    In the camera's frame (or without a frame) a point with z = 0 is a pixel u, v, as image viewers send it; one with z > 0 is a point [m],
    as is one in the world frame. Raises InputError for another frame and for points that the camera does not see.
    """
    point, frame = place_of(click, topic), click.header.frame_id
    if frame in ("", camera.frame_id):
        if point[2] == 0:
            return point[:2]
        point = camera.world_from_camera[:3, :3] @ point + camera.position
    elif frame != camera.world_frame_id:
        known = " or ".join(short(name) for name in dict.fromkeys((camera.frame_id, camera.world_frame_id)) if name)
        raise InputError(f"topic {topic}: a point in frame {short(frame)}, must be in {known}; transform it")
    with np.errstate(all="ignore"):
        pixel, depth = camera.project(point)
    if depth <= 0 or not np.isfinite(pixel).all():
        raise InputError(f"topic {topic}: the point lies {-depth:.3g} m behind the camera, must be before it; click on the object")
    return pixel


class Drawn(NamedTuple):
    """Lines that were clicked in a clip: whole ones, and first ends of others, by topic. A line stands until the next one of its topic is whole."""

    whole: Mapping[str, tuple[Any, Any]] = {}
    begun: Mapping[str, Any] = {}

    def clicked(self, topic: str, click: Any) -> Drawn:
        """With one more geometry_msgs/PointStamped: the first end of a line of LINES, or its second."""
        if topic not in self.begun:
            return self._replace(begun={**self.begun, topic: click})
        others = {name: end for name, end in self.begun.items() if name != topic}
        return Drawn({**self.whole, topic: (self.begun[topic], click)}, others)

    def on(self, settings: Settings, camera: Camera, names: Mapping[str, str]) -> Settings:
        """The settings with these lines, which go before what they say of the same, whatever they say of the clamp. Raises InputError with the
        topic's resolved name."""
        lines = {LINES[topic]: [float(v) for end in ends for v in pixel_of(end, camera, names[topic])] for topic, ends in self.whole.items()}
        told = {"clamp_box_m": None, **lines} if "clamp_px" in lines else lines
        return replace(settings, scene=replace(settings.scene, **told)) if lines else settings
