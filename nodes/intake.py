"""What ingest_node collects of a camera until the clip ends: bounded, whatever is sent for however long."""

from __future__ import annotations

from collections import Counter
from copy import copy
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.decode import declared_size
from diffphys_ros.bags.filmed import clip_of as clip_of_images
from diffphys_ros.bags.read import decoded
from diffphys_ros.bags.rig import Channel, Received
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

from .beside import COLOUR_INFO, DEPTH_INFO, Beside
from .clip_checks import check_colour, check_depth, check_labels, labels_of
from .convert import stamp_ns
from .limits import PIXEL_BYTES

SOURCE = "raw topics"
DEPTH, PRESSED_DEPTH = "depth", "depth/compressedDepth"
SPARE = 64  # images of depth and mask kept beside those that belong to a colour image: they may come before it
Size = tuple[int, int]  # width, height [px]


class Intake:
    """The messages of one clip. Every `take_...` raises InputError for a message that can be part of none, and keeps nothing of it."""

    def __init__(self, max_frames: int, max_bytes: int, beside: Beside | None = None) -> None:
        self.images: list[tuple[str, Any, Size]] = []  # topic, message, size
        self.depths: list[Any] = []
        self.masks: list[Any] = []
        self.beside = Beside() if beside is None else beside
        self._max_frames, self._max_bytes, self._bytes = max_frames, max_bytes, 0

    def begin(self) -> None:
        """Forget the images; camera and transforms, which are not sent again, stay."""
        self.images, self.depths, self.masks, self._bytes = [], [], [], 0

    def closed(self) -> Intake:
        """What was collected, handed over; both hear what comes beside the images, for a transform may be late."""
        taken = copy(self)
        self.begin()
        return taken

    @property
    def topic(self) -> str:
        """Where the images come from; empty before the first one."""
        return self.images[0][0] if self.images else ""

    @property
    def depth_topic(self) -> str:
        """Where depth comes from."""
        return PRESSED_DEPTH if self.depths and hasattr(self.depths[0], "format") else DEPTH

    @property
    def full(self) -> bool:
        """Whether another image like the last one would be too much."""
        return len(self.images) >= self._max_frames or self._bytes + (self._weight(-1) if self.images else 0) > self._max_bytes

    def take_image(self, topic: str, message: Any) -> None:
        """A colour image, raw or compressed."""
        size = _declared(message)
        if not hasattr(message, "format"):
            check_colour(message, self.beside.name(topic))
        self.images.append((topic, message, size))
        self._bytes += self._weight(-1)

    def take_depth(self, message: Any) -> None:
        """A depth image; those that are nearest to no colour image go once there are SPARE of them."""
        name, pressed = self.beside.name(DEPTH), hasattr(message, "format")
        if self.depths and pressed != (self.depth_topic == PRESSED_DEPTH):
            return  # the same images once more, by the other transport
        if pressed:
            declared_size(message.format, message.data)
        elif not message.height:
            raise InputError(f"topic {name}: an image without a pixel; publish depth images")
        else:
            check_depth(message, name)
        self.depths.append(message)
        self.depths = self._within(self.depths)

    def take_mask(self, message: Any) -> None:
        """A label image; the one nearest to the first colour image is used."""
        check_labels(message, self.beside.name("mask"))
        self.masks.append(message)
        if self.images:
            self.masks = [min(self.masks, key=lambda m: abs(stamp_ns(m) - stamp_ns(self.images[0][1])))]
        self.masks = self._within(self.masks)

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


class Images(NamedTuple):
    """What was collected, decoded: (stamp [ns], array) each."""

    frames: list[tuple[int, np.ndarray]]  # RGB
    frame_id: str
    depths: list[tuple[int, np.ndarray]]  # [m]
    depth_frame_id: str
    masks: list[tuple[int, np.ndarray]]
    notes: list[str]


def images_of(intake: Intake, settings: config.Settings) -> Images:
    """Decodes what was collected. Raises InputError where there is no image in it."""
    frames, frame_id, lost = _frames(intake)
    depths, depth_frame = ([], "") if settings.topics.depth == "none" else _metres(intake)
    return Images(frames, frame_id, depths, depth_frame, [(stamp_ns(m), labels_of(m, "mask")) for m in intake.masks], lost)


def received_of(intake: Intake, images: Images, settings: config.Settings) -> Received:
    """What is known by now beside the images. Raises InputError where the only camera_info that came was refused."""
    beside, stamps = intake.beside, [stamp for stamp, _ in images.frames]
    infos = beside.infos(COLOUR_INFO)
    if not infos and beside.unusable and settings.camera.fov_deg is None:
        raise InputError(f"{SOURCE}: {beside.unusable}")
    colour = Channel(beside.name(intake.topic), _size(images.frames), images.frame_id, infos, beside.name(COLOUR_INFO))
    depth = None
    if images.depths:
        depth = Channel(beside.name(intake.depth_topic), _size(images.depths), images.depth_frame_id, beside.infos(DEPTH_INFO), beside.name(DEPTH_INFO))
    imu = None if settings.topics.imu == "none" else beside.imu(min(stamps), max(stamps))
    return Received(SOURCE, stamps, colour, depth, beside.transforms, imu)


def clip_of(intake: Intake, settings: config.Settings, images: Images | None = None) -> tuple[Clip, np.ndarray]:
    """The clip of what was collected and the stamps (T,) [ns] of its images. Raises InputError where it makes none, NotYetError where what
    is heard beside the images may still complete it."""
    images = images_of(intake, settings) if images is None else images
    received = received_of(intake, images, settings)
    clip = clip_of_images(received, settings, images.frames, images.depths, images.masks, images.notes)
    return clip, np.array(received.stamps)


def _frames(intake: Intake) -> tuple[list[tuple[int, np.ndarray]], str, list[str]]:
    """(stamp [ns], RGB) of the images of the most common size, their frame, and a note on the others."""
    usual = Counter(size for *_, size in intake.images).most_common(1)[0][0]
    frames, frame_id, reason = [], "", "another size"
    for topic, message, size in intake.images:
        if size != usual:
            continue
        try:
            image = decoded(message, SOURCE, intake.beside.name(topic), colour=True)
        except InputError as error:
            reason = str(error)
            continue
        if image.ndim != 3:
            raise InputError(f"{SOURCE}: topic {intake.beside.name(topic)} holds depth, must hold colour; publish depth on the topic depth")
        frames.append((stamp_ns(message), image))
        frame_id = frame_id or message.header.frame_id
    if not frames:
        raise InputError(f"{SOURCE}: none of {len(intake.images)} images can be read; {reason}")
    left_out = len(intake.images) - len(frames)
    return frames, frame_id, [f"{left_out} of {len(intake.images)} images were left out ({reason})"] if left_out else []


def _metres(intake: Intake) -> tuple[list[tuple[int, np.ndarray]], str]:
    """(stamp [ns], depth [m]) of the depth images of the most common size, and their frame."""
    if not intake.depths:
        return [], ""
    sizes = [_declared(message) for message in intake.depths]
    usual = Counter(sizes).most_common(1)[0][0]
    chosen = [message for message, size in zip(intake.depths, sizes, strict=True) if size == usual]
    name = intake.beside.name(intake.depth_topic)
    return [(stamp_ns(message), decoded(message, SOURCE, name)) for message in chosen], next((m.header.frame_id for m in chosen if m.header.frame_id), "")


def _declared(message: Any) -> Size:
    return declared_size(message.format, message.data) if hasattr(message, "format") else (message.width, message.height)


def _size(images: list[tuple[int, np.ndarray]]) -> Size:
    return images[0][1].shape[1], images[0][1].shape[0]
