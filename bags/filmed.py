"""What was filmed, whole, to a clip: through the rig onto one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from diffphys_ros.bags.assemble import Stamped, assemble
from diffphys_ros.bags.rig import Received, Rig
from diffphys_ros.config import FrameSettings, Settings
from diffphys_ros.errors import InputError, named
from diffphys_ros.types import Clip


def clip_of(
    received: Received,
    settings: Settings,
    images: Stamped,
    depths: Stamped = (),
    masks: Stamped = (),
    notes: Sequence[str] = (),
    frames: FrameSettings | None = None,
) -> Clip:
    """The clip of colour images, depth [m] and label images as they were sent, decoded; the mask nearest to the first image is used.

    Settings used: sync.slop_s and those of Rig. Raises InputError.
    """
    rig = Rig(received, settings)
    if received.depth is not None:
        check_sizes(depths, received.depth.size, received.depth.topic, received.source)
    clip = assemble(
        [(stamp, rig.colour(stamp, image)) for stamp, image in images],
        [(stamp, rig.depth(stamp, image)) for stamp, image in depths],
        rig.camera,
        received.source,
        notes=[*notes, *rig.notes],
        slop_s=settings.sync.slop_s,
        frames=frames,
    )
    first = min(received.stamps)
    mask = min(masks, key=lambda item: abs(item[0] - first))[1] if masks else None
    return replace(clip, first_labels=None if mask is None else rig.labels(mask), gravity=rig.gravity)


def check_sizes(images: Stamped, size: tuple[int, int], topic: str, source: str) -> None:
    """Raises InputError where images (H, W) are not all of one size, width and height [px]."""
    if odd := next((image.shape for _, image in images if image.shape[:2] != size[::-1]), None):
        raise InputError(f"{source}: topic {named(topic)} holds images of {size[0]}x{size[1]} and of {odd[1]}x{odd[0]} px; record one size")
