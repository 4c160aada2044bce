"""What ingest_node collects of a camera until the clip ends: bounded, whatever is sent for however long."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.camera import camera_from_info, pose_in_root, undistorter
from diffphys_ros.bags.decode import MAX_PIXELS, declared_size
from diffphys_ros.bags.read import decoded, edge, nearest, seen_through
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

from .clip_checks import check_colour, check_depth, check_labels, labels_of
from .convert import stamp_ns
from .limits import PIXEL_BYTES

SOURCE = "raw topics"
SPARE = 64  # images of depth and mask kept beside those that belong to a colour image: they may come before it
MAX_LINKS = 1000  # of the transform tree
MAX_SIZES = 8  # of images, of which a camera_info is kept
Size = tuple[int, int]  # width, height [px]


class Intake:
    """The messages of one clip. Every `take_...` raises InputError for a message that can be part of none, and keeps nothing of it."""

    def __init__(self, max_frames: int, max_bytes: int) -> None:
        self.images: list[tuple[str, Any, Size]] = []  # topic, message, size
        self.depths: list[Any] = []
        self.masks: list[Any] = []
        self.infos: dict[Size, Any] = {}  # the latest camera_info by the size that it is for
        self.unusable = ""  # why the latest camera_info that was refused was
        self.links: dict[str, Any] = {}  # TransformStamped by child frame
        self._max_frames, self._max_bytes, self._bytes = max_frames, max_bytes, 0

    def begin(self) -> None:
        """Forget the images; camera and transforms, which are not sent again, stay."""
        self.images, self.depths, self.masks, self._bytes = [], [], [], 0

    def closed(self) -> Intake:
        """What was collected, handed over; this one keeps camera and transforms alone."""
        taken = copy(self)
        taken.links = dict(self.links)
        taken.infos = dict(self.infos)
        self.begin()
        return taken

    @property
    def topic(self) -> str:
        """Where the images come from; empty before the first one."""
        return self.images[0][0] if self.images else ""

    @property
    def full(self) -> bool:
        """Whether another image like the last one would be too much."""
        return len(self.images) >= self._max_frames or self._bytes + (self._weight(-1) if self.images else 0) > self._max_bytes

    def take_image(self, topic: str, message: Any) -> None:
        """A colour image, raw or compressed."""
        if hasattr(message, "format"):
            size = declared_size(message.format, message.data)
        else:
            check_colour(message, topic)
            size = message.width, message.height
        self.images.append((topic, message, size))
        self._bytes += self._weight(-1)

    def take_depth(self, message: Any) -> None:
        """A depth image; those that are nearest to no colour image go once there are SPARE of them."""
        if not message.height:
            raise InputError("topic depth: an image without a pixel; publish depth images")
        check_depth(message, "depth")
        self.depths.append(message)
        self.depths = self._within(self.depths)

    def take_mask(self, message: Any) -> None:
        """A label image; the one nearest to the first colour image is used."""
        check_labels(message, "mask")
        self.masks.append(message)
        if self.images:
            self.masks = [min(self.masks, key=lambda m: abs(stamp_ns(m) - stamp_ns(self.images[0][1])))]
        self.masks = self._within(self.masks)

    def take_info(self, message: Any, *, fov_known: Callable[[], bool]) -> None:
        """A camera_info; one without focal length is of use where the field of view is known."""
        size = (message.width, message.height)
        if size in self.infos and _calibration(self.infos[size]) == _calibration(message):
            return
        if size[0] * size[1] > MAX_PIXELS:
            raise InputError(f"topic camera_info: is for {size[0]}x{size[1]} px, at most {MAX_PIXELS} pixels are read; have the driver send smaller images")
        if not (message.k[0] == 0 and fov_known()):
            try:
                camera_from_info(message.k, message.d, *size, message.header.frame_id)
                undistorter(message.k, message.d, message.distortion_model, *(size if all(size) else (1, 1)))
            except InputError as error:
                self.unusable = f"topic camera_info: {error}"
                raise InputError(self.unusable) from error
        self.infos.pop(size, None)
        self.infos[size] = message
        if len(self.infos) > MAX_SIZES:
            del self.infos[next(iter(self.infos))]

    def take_link(self, link: Any) -> None:
        """A transform of the camera's tree; one that closes a circle is refused."""
        if link.child_frame_id not in self.links and len(self.links) >= MAX_LINKS:
            raise InputError(f"the transform tree has {MAX_LINKS} links, no more are kept; publish the camera's alone")
        links = self.links | {link.child_frame_id: link}
        pose_in_root(dict(edge(each) for each in links.values()), link.child_frame_id)
        self.links = links

    def _weight(self, index: int) -> int:
        """What an image takes [bytes]: as it is, or as listeners will hold it with depth and mask."""
        _, message, (width, height) = self.images[index]
        return max(len(message.data), width * height * PIXEL_BYTES)

    def _within(self, kept: list[Any]) -> list[Any]:
        """Without images that are of no use, as few as the bound wants."""
        if len(kept) > len(self.images) + SPARE:
            kept = self._beside(kept)
        room = self._max_bytes
        for index in range(len(kept) - 1, -1, -1):  # the latest first
            room -= len(kept[index].data)
            if room < 0:
                return kept[index + 1 :]
        return kept

    def _beside(self, kept: list[Any]) -> list[Any]:
        stamps = np.array([stamp_ns(message) for message in kept])
        chosen = {int(np.abs(stamps - stamp_ns(message)).argmin()) for _, message, _ in self.images}
        chosen |= set(range(len(kept) - SPARE // 2, len(kept)))
        return [kept[index] for index in sorted(chosen)]


def _calibration(info: Any) -> tuple[Any, ...]:
    return info.header.frame_id, info.distortion_model, list(info.k), list(info.d), list(info.p)


def clip_of(intake: Intake, settings: config.Settings) -> tuple[Clip, np.ndarray]:
    """The clip of what was collected and the stamps (T,) [ns] of its images. Raises InputError where it makes none."""
    topic = intake.topic
    frames, frame_id, lost = _frames(intake)
    size = (frames[0][1].shape[1], frames[0][1].shape[0])
    metres = [] if settings.topics.depth == "none" else _metres(intake.depths, size)
    info = intake.infos.get(size) or next(reversed(intake.infos.values()), None)
    if info is None and intake.unusable and settings.camera.fov_deg is None:
        raise InputError(f"{SOURCE}: {intake.unusable}")
    edges = dict(edge(link) for link in intake.links.values())
    camera, undistort, notes = seen_through(info, edges, settings, (*size, frame_id), SOURCE, image_topic=topic, info_topic="camera_info")
    mask = nearest([(stamp_ns(m), labels_of(m, "mask")) for m in intake.masks], frames[0][0]) if intake.masks else None
    if undistort:
        mask = None if mask is None else undistort(mask)
        frames, metres = ([(stamp, undistort(image)) for stamp, image in some] for some in (frames, metres))
    clip = replace(assemble(frames, metres, camera, SOURCE, notes=[*lost, *notes]), first_labels=mask)
    return clip, np.array([stamp for stamp, _ in frames])


def _frames(intake: Intake) -> tuple[list[tuple[int, np.ndarray]], str, list[str]]:
    """(stamp [ns], RGB) of the images of the most common size, their frame, and a note on the others."""
    usual = Counter(size for *_, size in intake.images).most_common(1)[0][0]
    frames, frame_id, reason = [], "", "another size"
    for topic, message, size in intake.images:
        if size != usual:
            continue
        try:
            image = decoded(message, SOURCE, topic)
        except InputError as error:
            reason = str(error)
            continue
        if image.ndim != 3:
            raise InputError(f"{SOURCE}: topic {topic} holds depth, must hold colour; publish depth on the topic depth")
        frames.append((stamp_ns(message), image))
        frame_id = frame_id or message.header.frame_id
    if not frames:
        raise InputError(f"{SOURCE}: none of {len(intake.images)} images can be read; {reason}")
    left_out = len(intake.images) - len(frames)
    return frames, frame_id, [f"{left_out} of {len(intake.images)} images were left out ({reason})"] if left_out else []


def _metres(depths: list[Any], size: Size) -> list[tuple[int, np.ndarray]]:
    """(stamp [ns], depth [m]) of the depth images of a size; of all where none has it, for the assembly to complain about."""
    fitting = [message for message in depths if (message.width, message.height) == size]
    return [(stamp_ns(message), decoded(message, SOURCE, "depth")) for message in fitting or depths]
