"""A clip as topics: what ingest_node, segment_node, splat_node and fit_node say to each other.

Frames keep the stamps they were recorded with, so that every listener assembles the very clip that reading the bag gives.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import uniform_clock
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip

Plain = tuple[str, dict[str, Any]]  # topic, fields


def clip_messages(clip: Clip, stamps: np.ndarray, pose: dict[str, Any] | None = None) -> Iterator[Plain]:
    """The messages of a clip; `stamps` (T,) [ns] as of slot_stamps, `pose` a TransformStamped where one was received.

    A clip without depth has one empty depth image, one without a mask topic an empty first mask, so that a listener need not guess
    whether more is to come.
    """
    camera, first, seen = clip.camera, int(stamps[0]), np.flatnonzero(clip.seen)
    yield "clip/camera_info", messages.camera_info(messages.header(first, camera.frame_id), camera)
    yield "clip/camera_pose", pose or messages.camera_pose(first, camera)
    yield "clip/gravity", messages.gravity(first, camera, clip.gravity)
    head = messages.header(first, camera.frame_id)
    yield "clip/first_mask", messages.no_image(head) if clip.first_labels is None else messages.image(head, clip.first_labels, "mono8")
    for k in seen:
        stamped = messages.header(int(stamps[k]), camera.frame_id)
        yield "clip/image", messages.image(stamped, clip.frames[k], "rgb8")
        if clip.depth is not None:
            yield "clip/depth", messages.image(stamped, clip.depth[k], "32FC1")
    if clip.depth is None:
        yield "clip/depth", messages.no_image(head)
    yield "clip/end", {"data": len(seen)}


def mask_messages(clip: Clip, stamps: np.ndarray) -> Iterator[Plain]:
    """The label image of every frame of the clock, lost frames included."""
    assert clip.labels is not None
    for stamp, labels in zip(stamps, clip.labels, strict=True):
        yield "clip/mask", messages.image(messages.header(int(stamp), clip.camera.frame_id), labels, "mono8")


def slot_stamps(clip: Clip, received: np.ndarray | None = None) -> np.ndarray:
    """Stamp of every frame of a clip (T,) [ns]: the received one, the clock's where a frame was lost or none is known."""
    stamps = clip.start_ns + np.rint(clip.times * 1e9).astype(np.int64)
    if received is not None:
        ordered = np.sort(received)
        stamps[uniform_clock(ordered, clip.source)[0]] = ordered
    return stamps
