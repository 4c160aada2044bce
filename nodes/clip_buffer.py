"""What a node has received of a clip."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import assemble
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

from .clip_checks import array_of, camera_of, check, gravity_of, labels_of, stamps_of
from .clip_topics import stamps_of_slots
from .convert import stamp_ns
from .limits import MAX_FRAMES, MAX_MIB, MIB
from .shared import shared_zeros

SOURCE = "topics clip/*"
INFO, POSE, GRAVITY, FIRST_MASK, END, MASK = "clip/camera_info", "clip/camera_pose", "clip/gravity", "clip/first_mask", "clip/end", "clip/mask"
IMAGE, DEPTH = "clip/image", "clip/depth"
OVERFULL = "of another clip, for this one was too large"
MOST_SINGLES = 16  # messages kept of topics that have one per clip: those of the clips before and after may come in any order


@dataclass
class ClipBuffer:
    """What was received of a clip, at most `max_bytes` of images and MAX_FRAMES of a kind.

    A clip is known by the stamp of its first image. Its camera_info opens it; pose, first mask and end carry that stamp, and the end names
    the stamps of the images, which depth images and masks share. Nothing else is used, in whatever order it comes.
    """

    max_bytes: int = MAX_MIB.default * MIB
    first_alone: bool = False  # whether the pixels of frame 0 are all that is wanted of images, depth and masks
    names: Mapping[str, str] = field(default_factory=dict)  # resolved names of the topics, for people
    info: Any = None
    images: dict[int, Any] = field(default_factory=dict)  # by stamp [ns]
    depths: dict[int, Any] = field(default_factory=dict)
    masks: dict[int, Any] = field(default_factory=dict)  # of every frame of the clip, or none
    fresh: dict[int, Any] = field(default_factory=dict)  # of a set of masks that is not complete
    singles: dict[tuple[str, int], Any] = field(default_factory=dict)  # by topic and stamp
    sent: dict[tuple[str, int], int | None] = field(default_factory=dict)  # when [ns], by topic and stamp; not of masks, made on another clock
    opened_ns: int | None = None  # when `info` was sent, where that is known
    overfull: bool = False
    bytes: int = 0  # of images, depths and masks
    whole: Clip | None = None  # in the place of its images, without labels
    mask_set: int = 0  # how many sets of masks were complete, each unlike the one before

    def take(self, topic: str, message: Any, sent_ns: int | None = None) -> bool:
        """Keep a message of a clip/* topic, sent at this time where that is known; returns whether another clip began with it.

        Raises InputError for a message that cannot be part of a clip, and for one that would make it too large.
        """
        check(topic, message, self.name(topic))
        another = False
        if topic == INFO:
            another = self._open(message, sent_ns)
        elif topic != MASK and sent_ns is not None and self.opened_ns is not None and sent_ns < self.opened_ns:
            return False
        elif topic in (IMAGE, DEPTH, MASK):
            self._keep(topic, message, sent_ns)
        else:
            self._keep_single(topic, message, sent_ns)
        self._look_for_masks()
        return another

    def name(self, topic: str) -> str:
        """A topic's resolved name."""
        return self.names.get(topic, topic)

    @property
    def id(self) -> int | None:
        """The clip's first stamp [ns]; None before a clip is opened."""
        return None if self.info is None else stamp_ns(self.info)

    @property
    def announced(self) -> tuple[int, ...]:
        """Stamps of the clip's images as clip/end names them, ascending [ns]; empty before it came."""
        end = self.single(END)
        return () if end is None else end

    def single(self, topic: str) -> Any:
        """The clip's message of a topic that has one per clip, the stamps of clip/end; None where it has not come."""
        return None if self.id is None else self.singles.get((topic, self.id))

    def strangers(self) -> int:
        """Messages kept that are of no use for a clip whose end has come."""
        known = set(self.announced)
        return sum(stamp not in known for kept in (self.images, self.depths) for stamp in kept) if known else 0

    def missing(self, *, masks: bool) -> str:
        """What is still to come, in words; empty where the clip is complete."""
        if self.overfull:
            return f"{self.name(INFO)} {OVERFULL}"
        for topic, there in ((IMAGE, self.images or self.whole), (END, self.single(END) or (self.info is None and any(t == END for t, _ in self.singles))), (INFO, self.info)):
            if not there:
                return self.name(topic)
        frames = len(self._frames())
        if self.whole is None and frames < len(self.announced):
            return f"{self.name(IMAGE)} (all {len(self.announced)} that {self.name(END)} announced, of {self.info.width}x{self.info.height} px; {frames} came)"
        for topic in (POSE, GRAVITY, FIRST_MASK):
            if self.single(topic) is None:
                return self.name(topic)
        if self.whole is None and not self._without_depth and any(stamp not in self.depths for stamp in self.announced):
            return self.name(DEPTH)
        return self.name(MASK) if masks and not self.masks and self._slots() else ""

    def clip(self) -> Clip:
        """The complete clip, with labels where masks came, in memory that other processes can share. Raises InputError for messages that make none."""
        clip = self.whole or self._assembled()
        return clip.with_labels(self._labels(clip)) if self.masks else clip

    def settle(self, clip: Clip) -> None:
        """Keep the clip that was made of the images in their place. Labels come from the masks."""
        for topic, stamp in list(self.sent):
            if topic in (IMAGE, DEPTH):
                self._drop(topic, stamp)
        self._let_go()
        self.whole = replace(clip, labels=None)
        self.bytes += _size(self.whole)

    def _let_go(self) -> None:
        if self.whole is not None:
            self.bytes -= _size(self.whole)
            self.whole = None

    def _assembled(self) -> Clip:
        frames, first = self._frames(), self.announced[0]
        depths = [] if self._without_depth else [(s, array_of(m)) for s, m in self.depths.items() if s in frames and m.data]
        images = [(s, array_of(frames[first] if self.first_alone else m)) for s, m in list(frames.items())[: 2 if self.first_alone else None]]
        camera = camera_of(self.info, self.single(POSE))
        clip = replace(assemble(images, depths, camera, SOURCE, zeros=shared_zeros), gravity=gravity_of(self.single(GRAVITY)))
        first_mask = self.single(FIRST_MASK)
        if first_mask.height:
            clip = replace(clip, first_labels=labels_of(first_mask, self.name(FIRST_MASK)))
        return clip

    def stamps(self) -> np.ndarray:
        """Stamps of the clip's images, ascending [ns]."""
        return np.array(self.announced, np.int64)

    def first_labels_crc(self) -> int:
        """CRC-32 of the mask of frame 0: what Gaussians of this clip were fitted in. Masks must be there."""
        return zlib.crc32(labels_of(self.masks[self.announced[0]], self.name(MASK)).tobytes())

    def copy(self) -> ClipBuffer:
        """The same messages, for a thread that must not see later ones."""
        kept = {name: dict(getattr(self, name)) for name in ("images", "depths", "masks", "fresh", "singles", "sent")}
        return replace(self, **kept)  # type: ignore[arg-type]

    def _open(self, info: Any, sent_ns: int | None) -> bool:
        before, known = self.id, sent_ns is not None and self.opened_ns is not None
        another = self.info is not None and (sent_ns != self.opened_ns if known else stamp_ns(info) != before)
        for (topic, stamp), then in list(self.sent.items()):
            if (another and then is None) or (then is not None and sent_ns is not None and then < sent_ns):
                self._drop(topic, stamp)
        if another:
            self._let_go()
        self.info, self.opened_ns, self.overfull = info, sent_ns, False
        if self.first_alone:
            for stamp in {*self.images, *self.depths}:
                self._strip(stamp)
        if another and self.id != before:  # published once more it has the same masks, and its stage may be done before this is heard
            self._drop_masks({s: m for s, m in self.fresh.items() if s >= stamp_ns(info)})
        return another

    def _keep(self, topic: str, message: Any, sent_ns: int | None) -> None:
        kept, stamp = {IMAGE: self.images, DEPTH: self.depths, MASK: self.fresh}[topic], stamp_ns(message)
        if topic == MASK and stamp in kept:  # another set begins before this one was complete
            self.bytes -= sum(len(m.data) for m in kept.values())
            kept.clear()
        size = self.bytes + len(message.data) - (len(kept[stamp].data) if stamp in kept else 0)
        if self.overfull or size > self.max_bytes or len(kept) >= MAX_FRAMES:
            for name, at in list(self.sent):
                if name in (IMAGE, DEPTH):
                    self._drop(name, at)
            self._drop_masks({})
            self._let_go()
            self.overfull = True
            raise InputError(
                f"topic {self.name(topic)}: the clip has over {MAX_FRAMES} messages or {self.max_bytes // MIB} MiB and is dropped; publish a shorter "
                "or smaller one, or raise the parameter max_mib"
            )
        kept[stamp], self.bytes = message, size
        if self.first_alone and self.id is not None:
            self._strip(stamp)
        if topic != MASK:
            self.sent[topic, stamp] = sent_ns

    def _strip(self, stamp: int) -> None:
        """Let the pixels of an image go that is not the first one."""
        for kept in (self.images, self.depths):
            if stamp in kept and stamp != self.id:
                self.bytes -= len(kept[stamp].data)
                kept[stamp].data = b""

    def _keep_single(self, topic: str, message: Any, sent_ns: int | None) -> None:
        key = topic, stamp_ns(message)
        self.singles.pop(key, None)
        self.singles[key] = stamps_of(message) if topic == END else message
        self.sent[key] = sent_ns
        if len(self.singles) > MOST_SINGLES:
            self._drop(*next(each for each in self.singles if each[1] != self.id))

    def _look_for_masks(self) -> None:
        """Take over a set of masks that is complete, where it is not the one that is there."""
        slots = self._slots() if self.fresh else ()
        if not slots or any(stamp not in self.fresh for stamp in slots):
            return
        found, wanted = {stamp: self.fresh[stamp] for stamp in slots}, slots[: 1 if self.first_alone else None]
        if not (self.masks.keys() == found.keys() and all(self.masks[s].data == found[s].data and self.masks[s].step == found[s].step for s in wanted)):
            self.mask_set += 1
        self._drop_masks({})
        for stamp in slots[len(wanted) :]:
            found[stamp].data = b""
        self.masks = found
        self.bytes += sum(len(m.data) for m in found.values())

    def _drop_masks(self, fresh: dict[int, Any]) -> None:
        """Keep no masks but these of a set that is not complete."""
        self.bytes += sum(len(m.data) for m in fresh.values()) - sum(len(m.data) for kept in (self.masks, self.fresh) for m in kept.values())
        self.masks, self.fresh = {}, fresh

    def _drop(self, topic: str, stamp: int) -> None:
        del self.sent[topic, stamp]
        if topic in (IMAGE, DEPTH):
            self.bytes -= len((self.images if topic == IMAGE else self.depths).pop(stamp).data)
        else:
            del self.singles[topic, stamp]

    def _frames(self) -> dict[int, Any]:
        """The clip's images that are there, of the camera's size."""
        there = ((s, self.images[s]) for s in self.announced if s in self.images)
        return {s: m for s, m in there if (m.width, m.height) == (self.info.width, self.info.height)}

    def _labels(self, clip: Clip) -> np.ndarray:
        labels, size = shared_zeros(clip.frames.shape[:3], np.uint8), clip.frames.shape[1:3]
        for k, stamp in enumerate(sorted(self.masks)[: 1 if self.first_alone else len(clip)]):
            own = labels_of(self.masks[stamp], self.name(MASK))
            if own.shape != size:
                raise InputError(f"topic {self.name(MASK)}: a mask has {own.shape[1]}x{own.shape[0]} px, the frames have {size[1]}x{size[0]} px; publish masks of the frame's size")
            labels[k] = own
        return labels

    @property
    def _without_depth(self) -> bool:
        told = None if self.id is None else self.depths.get(self.id)
        return told is not None and not told.height

    def _slots(self) -> tuple[int, ...]:
        """Stamps of the clip's frames, lost ones included; none where the images' make no clip, for clip() to complain about."""
        try:
            return stamps_of_slots(self.announced, SOURCE) if self.announced else ()
        except InputError:
            return ()


def _size(clip: Clip) -> int:
    """Bytes of a clip's images."""
    return clip.frames.nbytes + (0 if clip.depth is None else clip.depth.nbytes)
