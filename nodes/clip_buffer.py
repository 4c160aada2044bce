"""What a node has received of a clip."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from diffphys_ros.bags.assemble import assemble, uniform_clock
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

from .clip_checks import array_of, camera_of, check, gravity_of, labels_of
from .convert import stamp_ns
from .limits import MAX_FRAMES, MAX_MIB, MIB

SOURCE = "topics clip/*"
INFO, MASK = "clip/camera_info", "clip/mask"
SINGLE = {"clip/camera_pose": "pose", "clip/gravity": "gravity", "clip/first_mask": "first_mask", "clip/end": "end"}  # attribute of a ClipBuffer
MANY = {"clip/image": "images", "clip/depth": "depths", MASK: "masks"}  # attribute, by stamp
OVERFULL = f"{INFO} of another clip, for this one was too large"


@dataclass
class ClipBuffer:
    """What was received of a clip, at most `max_bytes` of images and MAX_FRAMES of a kind.

    A clip is opened by its camera_info: what was sent before that belongs to an earlier clip and goes. Topics arrive in any order, so
    what was sent after it may well be here already.
    """

    max_bytes: int = MAX_MIB.default * MIB
    info: Any = None
    pose: Any = None
    gravity: Any = None
    first_mask: Any = None
    end: Any = None  # announces the number of images
    images: dict[int, Any] = field(default_factory=dict)  # by stamp [ns]
    depths: dict[int, Any] = field(default_factory=dict)
    masks: dict[int, Any] = field(default_factory=dict)
    opened_ns: int | None = None  # when `info` was sent, where that is known
    overfull: bool = False
    bytes: int = 0  # of images, depths and masks
    sent: dict[tuple[str, int], int | None] = field(default_factory=dict)  # [ns], by topic and stamp

    def take(self, topic: str, message: Any, sent_ns: int | None = None) -> bool:
        """Keep a message of a clip/* topic, sent at this time where that is known; returns whether another clip began with it.

        Raises InputError for a message that cannot be part of a clip, and for one that would make it too large.
        """
        check(topic, message)
        # masks come from another node, whose clock is no measure
        if topic != MASK and sent_ns is not None and self.opened_ns is not None and sent_ns < self.opened_ns:
            return False
        if topic == INFO:
            return self._open(message, sent_ns)
        if topic in MANY:
            self._keep(topic, message, sent_ns)
        else:
            setattr(self, SINGLE[topic], message)
            self.sent[topic, 0] = sent_ns
        return False

    @property
    def count(self) -> int | None:
        """Images announced by clip/end."""
        return None if self.end is None else self.end.data

    def missing(self, *, masks: bool) -> str:
        """What is still to come, in words; empty where the clip is complete."""
        if self.overfull:
            return OVERFULL
        for topic, there in (("clip/image", self.images), ("clip/end", self.end), (INFO, self.info)):
            if not there:
                return topic
        frames = self._frames()
        wanted = {
            f"clip/image (all {self.count} that clip/end announced, of {self.info.width}x{self.info.height} px)": len(frames) >= (self.count or 0),
            "clip/camera_pose": self.pose is not None,
            "clip/gravity": self.gravity is not None,
            "clip/first_mask": self.first_mask is not None,
            "clip/depth": len(self.depths) >= (1 if self._without_depth else len(frames)),
        }
        late = next((topic for topic, there in wanted.items() if not there), "")
        return late or (MASK if masks and len(self._masks()) < self._slots() else "")

    def clip(self) -> Clip:
        """The complete clip, with labels where masks came. Raises InputError for messages that make none."""
        depths = [] if self._without_depth else [(s, array_of(m)) for s, m in sorted(self.depths.items()) if m.height]
        images = [(s, array_of(m)) for s, m in sorted(self._frames().items())]
        clip = replace(assemble(images, depths, camera_of(self.info, self.pose), SOURCE), gravity=gravity_of(self.gravity))
        if self.first_mask is not None and self.first_mask.height:
            clip = replace(clip, first_labels=labels_of(self.first_mask, "clip/first_mask"))
        masks = self._masks()
        if not masks:
            return clip
        labels, size = [labels_of(m, MASK) for _, m in sorted(masks.items())], clip.frames.shape[1:3]
        if len(labels) != len(clip) or any(each.shape != size for each in labels):
            odd = next((each for each in labels if each.shape != size), labels[0])
            raise InputError(
                f"topic {MASK}: {len(labels)} masks, of {odd.shape[::-1]} px, for {len(clip)} frames of {size[::-1]} px; "
                "publish one per frame in the frame's size"
            )
        return clip.with_labels(np.stack(labels))

    def stamps(self) -> np.ndarray:
        """Stamps of the clip's images, ascending [ns]."""
        return np.array(sorted(self._frames()), np.int64)

    def copy(self) -> ClipBuffer:
        """The same messages, for a thread that must not see later ones."""
        return replace(self, images=dict(self.images), depths=dict(self.depths), masks=dict(self.masks), sent=dict(self.sent))

    def _open(self, info: Any, sent_ns: int | None) -> bool:
        known = sent_ns is not None and self.opened_ns is not None
        another = self.info is not None and (sent_ns != self.opened_ns if known else stamp_ns(info) != stamp_ns(self.info))
        for (topic, stamp), then in list(self.sent.items()):
            if (another and (then is None or topic == MASK)) or (then is not None and sent_ns is not None and topic != MASK and then < sent_ns):
                self._drop(topic, stamp)
        self.info, self.opened_ns, self.overfull = info, sent_ns, False
        return another

    def _keep(self, topic: str, message: Any, sent_ns: int | None) -> None:
        kept, stamp = getattr(self, MANY[topic]), stamp_ns(message)
        before = len(kept[stamp].data) if stamp in kept else 0
        size = self.bytes + len(message.data) - before
        if self.overfull or size > self.max_bytes or len(kept) >= MAX_FRAMES:
            for name, at in list(self.sent):
                if name in MANY:
                    self._drop(name, at)
            self.overfull = True
            raise InputError(
                f"topic {topic}: the clip has over {MAX_FRAMES} messages or {self.max_bytes // MIB} MiB and is dropped; publish a shorter "
                "or smaller one, or raise the parameter max_mib"
            )
        kept[stamp], self.bytes, self.sent[topic, stamp] = message, size, sent_ns

    def _drop(self, topic: str, stamp: int) -> None:
        del self.sent[topic, stamp]
        if topic in MANY:
            self.bytes -= len(getattr(self, MANY[topic]).pop(stamp).data)
        else:
            setattr(self, SINGLE[topic], None)

    def _frames(self) -> dict[int, Any]:
        """The images of the camera's size."""
        size = None if self.info is None else (self.info.width, self.info.height)
        return {s: m for s, m in self.images.items() if size is None or (m.width, m.height) == size}

    def _masks(self) -> dict[int, Any]:
        """The masks of the clip's own time; a clip before it had others."""
        stamps = self.stamps()
        if not len(stamps):
            return {}
        first, last = int(stamps[0]), int(stamps[-1])
        margin = (last - first) // (2 * max(len(stamps) - 1, 1))
        return {s: m for s, m in self.masks.items() if first - margin <= s <= last + margin}

    @property
    def _without_depth(self) -> bool:
        return bool(self.depths) and not any(message.height for message in self.depths.values())

    def _slots(self) -> int:
        try:
            return int(uniform_clock(self.stamps(), SOURCE)[0][-1]) + 1
        except InputError:  # stamps that make no clip are for clip() to complain about
            return 0
