"""What ingest_node keeps of a camera: a ring of the latest images, or those of a clip; bounded, whatever is sent for however long."""

from __future__ import annotations

from bisect import bisect_left, insort
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros.bags.decode import declared_size
from diffphys_ros.errors import InputError

from .beside import Beside
from .clip_checks import check_colour, check_depth, check_labels
from .convert import stamp_ns
from .limits import COLOUR_BYTES, DEPTH_BYTES, LABEL_BYTES

SPARE = 64  # images of depth and mask kept beside those that belong to a colour image: they may come before it
DEPTH, PRESSED_DEPTH = "depth", "depth/compressedDepth"
BESIDE_NS = 10**9  # by which depth and masks may be older than the oldest image that is kept
Size = tuple[int, int]  # width, height [px]


class Taken(NamedTuple):
    """A colour image, raw or compressed."""

    stamp: int  # [ns]
    topic: str
    message: Any
    size: Size


class Intake:
    """Messages of one clip, or of the time before one. Every `take_...` raises InputError for a message that can be part of none, and keeps
    nothing of it. What is kept has at most `max_bytes`, as it is and as it will be handed on."""

    def __init__(self, max_frames: int, max_bytes: int, beside: Beside | None = None) -> None:
        self.images: list[Taken] = []  # ascending
        self.depths: list[Any] = []
        self.masks: list[Any] = []
        self.beside = Beside() if beside is None else beside
        self.one_mask = True  # whether the one nearest to the first image is enough, which is known while a clip is recorded
        self.elsewhere = 0  # bytes that others hold of the same bound
        self._max_frames, self._max_bytes = max_frames, max_bytes
        self._raw = self._pixels = 0  # bytes and pixels of the images

    def begin(self) -> None:
        """Forget the images; camera and transforms, which are not sent again, stay."""
        self.images, self.depths, self.masks = [], [], []
        self._raw = self._pixels = 0

    def closed(self) -> Intake:
        """What was collected, handed over; both hear what comes beside the images, for a transform may be late."""
        taken = Intake(self._max_frames, self._max_bytes, self.beside)
        taken.images, taken.depths, taken.masks, taken._raw, taken._pixels = self.images, self.depths, self.masks, self._raw, self._pixels
        self.begin()
        return taken

    def keep_latest(self, seconds: float) -> None:
        """As a ring: forget what is older than this, and the oldest where there is too much."""
        while len(self.images) > 1 and (self.span_s > seconds or self._too_much()):
            self.forget_before(self.images[1].stamp)

    def forget_before(self, stamp: int) -> None:
        """Drop images from before a stamp [ns], and what is beside them."""
        gone = bisect_left(self.images, stamp, key=lambda image: image.stamp)
        for image in self.images[:gone]:
            self._raw, self._pixels = self._raw - len(image.message.data), self._pixels - image.size[0] * image.size[1]
        del self.images[:gone]
        self.depths, self.masks = ([m for m in some if stamp_ns(m) >= stamp - BESIDE_NS] for some in (self.depths, self.masks))

    @property
    def bytes(self) -> int:
        """Of all messages that are kept."""
        return self._raw + sum(len(m.data) for some in (self.depths, self.masks) for m in some)

    @property
    def span_s(self) -> float:
        """From the first to the last image [s]."""
        return (self.images[-1].stamp - self.images[0].stamp) * 1e-9 if self.images else 0.0

    @property
    def topic(self) -> str:
        """Where the images come from; empty before the first one."""
        return self.images[0].topic if self.images else ""

    @property
    def depth_topic(self) -> str:
        """Where depth comes from."""
        return PRESSED_DEPTH if self.depths and hasattr(self.depths[0], "format") else DEPTH

    @property
    def full(self) -> bool:
        """Whether another image like the last one would be too much."""
        if not self.images:
            return False
        last = self.images[-1]
        more = len(last.message.data) + (len(self.depths[-1].data) if self.depths else 0)
        return len(self.images) >= self._max_frames or self._too_much(more, last.size[0] * last.size[1])

    def _too_much(self, more: int = 0, pixels: int = 0) -> bool:
        """Whether the bound is passed with so many bytes and pixels more."""
        handed_on = (self._pixels + pixels) * (COLOUR_BYTES + LABEL_BYTES + (DEPTH_BYTES if self.depths else 0))
        return max(self.bytes + self.elsewhere + more, handed_on) > self._max_bytes or len(self.images) > self._max_frames

    def take_image(self, topic: str, message: Any) -> None:
        """A colour image, raw or compressed; one that comes late finds its place, unless the oldest that is kept is younger."""
        size, name = size_of(message), self.beside.name(topic)
        if not hasattr(message, "format"):
            check_colour(message, name)
        image = Taken(stamp_ns(message), topic, message, size)
        if self.images and image.stamp <= self.images[-1].stamp:
            if image.stamp < self.images[0].stamp or any(image.stamp == other.stamp for other in self.images):
                late = (self.images[-1].stamp - image.stamp) * 1e-9
                raise InputError(f"topic {name}: an image came twice or late, {late:.3g} s before the latest; have the driver stamp and send its images in order")
            insort(self.images, image, key=lambda other: other.stamp)
        else:
            self.images.append(image)
        self._raw, self._pixels = self._raw + len(message.data), self._pixels + size[0] * size[1]

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
        if self.images and self.one_mask:
            self.masks = [min(self.masks, key=lambda m: abs(stamp_ns(m) - self.images[0].stamp))]
        self.masks = self._within(self.masks)

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
        chosen = {int(np.abs(stamps - image.stamp).argmin()) for image in self.images}
        chosen |= set(range(len(kept) - SPARE // 2, len(kept)))
        return [kept[index] for index in sorted(chosen)]


def size_of(message: Any) -> Size:
    """Width and height [px] of an Image or CompressedImage. Raises InputError where the latter declares none."""
    return declared_size(message.format, message.data) if hasattr(message, "format") else (message.width, message.height)
