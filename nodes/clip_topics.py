"""A clip as topics: what ingest_node, segment_node, splat_node and fit_node say to each other.

Frames keep the stamps they were recorded with, so that every listener assembles the very clip that reading the bag gives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import uniform_clock
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Camera, Clip

Plain = tuple[str, dict[str, Any]]  # topic, fields


def clip_messages(clip: Clip, stamps: np.ndarray, pose: dict[str, Any] | None = None) -> Iterator[Plain]:
    """The messages of a clip; `stamps` (T,) [ns] as of slot_stamps, `pose` a TransformStamped where one was received."""
    seen = np.flatnonzero(clip.seen)
    yield from opening(clip.camera, int(stamps[0]), clip.first_labels, pose, clip.gravity)
    for k in seen:
        yield from frame(clip.camera, int(stamps[k]), clip.frames[k], None if clip.depth is None else clip.depth[k])
    yield from ending(clip.camera, [int(stamps[k]) for k in seen], with_depth=clip.depth is not None)


def opening(
    camera: Camera, first_ns: int, first_labels: np.ndarray | None, pose: dict[str, Any] | None = None, gravity: np.ndarray | None = None
) -> Iterator[Plain]:
    """What is said of a clip before its frames. All of it carries the stamp of the first image, by which a clip is known.

    A clip without a mask topic has an empty first mask, so that a listener need not guess whether one is to come.
    """
    head = messages.header(first_ns, camera.frame_id)
    yield "clip/camera_info", messages.camera_info(head, camera)
    link = pose or messages.camera_pose(first_ns, camera)
    yield "clip/camera_pose", link | {"header": messages.header(first_ns, link["header"]["frame_id"])}
    yield "clip/gravity", messages.gravity(first_ns, camera, gravity)
    yield "clip/first_mask", messages.no_image(head) if first_labels is None else messages.image(head, first_labels, "mono8")


def frame(camera: Camera, stamp_ns: int, pixels: np.ndarray, depth: np.ndarray | None) -> Iterator[Plain]:
    """An image (H, W, 3) uint8 and, where there is one, its depth (H, W) float32 [m]."""
    head = messages.header(stamp_ns, camera.frame_id)
    yield "clip/image", messages.image(head, pixels, "rgb8")
    if depth is not None:
        yield "clip/depth", messages.image(head, depth, "32FC1")


def ending(camera: Camera, stamps: Sequence[int], *, with_depth: bool) -> Iterator[Plain]:
    """What completes a clip of images with these stamps [ns]; one without depth has one empty depth image."""
    if not with_depth:
        yield "clip/depth", messages.no_image(messages.header(stamps[0], camera.frame_id))
    yield "clip/end", messages.camera_path(stamps, camera)


def mask_messages(clip: Clip, stamps: np.ndarray) -> Iterator[Plain]:
    """The label image of every frame of the clock, lost frames included."""
    assert clip.labels is not None
    for stamp, labels in zip(stamps, clip.labels, strict=True):
        yield "clip/mask", messages.image(messages.header(int(stamp), clip.camera.frame_id), labels, "mono8")


def slot_stamps(clip: Clip, received: np.ndarray | None = None) -> np.ndarray:
    """Stamp of every frame of a clip (T,) [ns]: the received one, the clock's where a frame was lost or none is known."""
    if received is not None:
        return np.array(stamps_of_slots(tuple(np.sort(received).tolist()), clip.source), np.int64)
    return clip.start_ns + np.rint(clip.times * 1e9).astype(np.int64)


@lru_cache(4)
def stamps_of_slots(received: tuple[int, ...], source: str) -> tuple[int, ...]:
    """Stamp of every slot of the clock of frames with these ascending stamps [ns]. Raises InputError where they follow no clock."""
    slots, period_s, _ = uniform_clock(np.array(received, np.int64), source)
    stamps = received[0] + np.rint(np.arange(slots[-1] + 1) * period_s * 1e9).astype(np.int64)
    stamps[slots] = received
    return tuple(stamps.tolist())
