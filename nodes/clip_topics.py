"""A clip as topics, and back: what ingest_node, segment_node, splat_node and fit_node say to each other.

Frames keep the stamps they were recorded with, so that every listener assembles the very clip that reading the bag gives.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import assemble, uniform_clock
from diffphys_ros.bags.camera import camera_from_info, pose_in_root
from diffphys_ros.bags.decode import decode_image
from diffphys_ros.bags.read import decoded, edge
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Camera, Clip

from .convert import stamp_ns

SOURCE = "topics clip/*"
SINGLE = {"clip/camera_info": "info", "clip/camera_pose": "pose", "clip/first_mask": "first_mask"}  # attribute of a ClipBuffer
Plain = tuple[str, dict[str, Any]]  # topic, fields


def clip_messages(clip: Clip, stamps: np.ndarray, pose: dict[str, Any] | None = None) -> Iterator[Plain]:
    """The messages of a clip; `stamps` (T,) [ns] as of slot_stamps, `pose` a TransformStamped where one was received.

    A clip without depth has one empty depth image, one without a mask topic an empty first mask, so that a listener need not guess
    whether more is to come.
    """
    camera, first, seen = clip.camera, int(stamps[0]), np.flatnonzero(clip.seen)
    yield "clip/camera_info", messages.camera_info(messages.header(first, camera.frame_id), camera)
    yield "clip/camera_pose", pose or messages.camera_pose(first, camera)
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


@dataclass
class ClipBuffer:
    """What was received of a clip."""

    info: Any = None
    pose: Any = None
    first_mask: Any = None
    count: int | None = None  # images announced by clip/end
    images: dict[int, Any] = field(default_factory=dict)  # by stamp [ns]
    depths: dict[int, Any] = field(default_factory=dict)
    masks: dict[int, Any] = field(default_factory=dict)

    def take(self, topic: str, message: Any) -> None:
        """Keep a message of a clip/* topic."""
        stamped = {"clip/image": self.images, "clip/depth": self.depths, "clip/mask": self.masks}
        if topic in stamped:
            stamped[topic][stamp_ns(message)] = message
        elif topic == "clip/end":
            self.count = message.data
        else:
            setattr(self, SINGLE[topic], message)

    def missing(self, *, masks: bool) -> str:
        """What is still to come, in words; empty where the clip is complete."""
        wanted = {
            "clip/image": bool(self.images),
            "clip/end": self.count is not None,
            "clip/image (all that clip/end announced)": len(self.images) >= (self.count or 0),
            "clip/camera_info": self.info is not None,
            "clip/camera_pose": self.pose is not None,
            "clip/first_mask": self.first_mask is not None,
            "clip/depth": len(self.depths) >= (1 if self._without_depth else len(self.images)),
        }
        late = next((topic for topic, there in wanted.items() if not there), "")
        return late or ("clip/mask" if masks and len(self.masks) < self._slots else "")

    def clip(self) -> Clip:
        """The complete clip, with labels where masks came. Raises InputError for messages that make none."""
        depths = [] if self._without_depth else [(s, _decoded(m)) for s, m in sorted(self.depths.items())]
        clip = assemble([(s, _decoded(m)) for s, m in sorted(self.images.items())], depths, self.camera(), SOURCE)
        if self.first_mask is not None and self.first_mask.height:
            clip = replace(clip, first_labels=labels_of(self.first_mask, "clip/first_mask"))
        if not self.masks:
            return clip
        labels = [labels_of(m, "clip/mask") for _, m in sorted(self.masks.items())]
        if len(labels) != len(clip) or labels[0].shape != clip.frames.shape[1:3]:
            raise InputError(
                f"topic clip/mask: {len(labels)} masks of {labels[0].shape[::-1]} px for {len(clip)} frames of {clip.frames.shape[2:0:-1]} px; "
                "publish one per frame in the frame's size"
            )
        return clip.with_labels(np.stack(labels))

    def stamps(self) -> np.ndarray:
        """Stamps of the received images, ascending [ns]."""
        return np.array(sorted(self.images), np.int64)

    @property
    def _without_depth(self) -> bool:
        return any(not message.height for message in self.depths.values())

    @property
    def _slots(self) -> int:
        try:
            return int(uniform_clock(self.stamps(), SOURCE)[0][-1]) + 1
        except InputError:  # stamps that make no clip are for clip() to complain about
            return 0

    def camera(self) -> Camera:
        """The camera, once info and pose came. Raises InputError where they make none."""
        info, frame_id = self.info, self.info.header.frame_id
        child, (parent, matrix) = edge(self.pose)
        pose, root = pose_in_root({} if child == parent else {child: (parent, matrix)}, frame_id)
        return camera_from_info(info.k, info.d, info.width, info.height, frame_id, pose, root)


def _decoded(message: Any) -> np.ndarray:
    return decode_image(message.encoding, message.height, message.width, message.step, message.is_bigendian, message.data)


def labels_of(message: Any, topic: str) -> np.ndarray:
    """Label image uint8 (H, W) of a sensor_msgs/Image. Raises InputError, naming the topic, where it is not mono8."""
    if message.encoding not in ("mono8", "8UC1"):
        raise InputError(f"topic {topic}: encoding is {message.encoding!r}, must be mono8; publish label images")
    return decoded(message, "topics", topic)[..., 0]
