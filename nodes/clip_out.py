"""What ingest_node collected, as the messages of a clip; one image at a time is decoded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.assemble import MOST_SIDE, check_extent, said_of_pairs, uniform_clock
from diffphys_ros.bags.read import decoded
from diffphys_ros.bags.rig import Channel, Received, Rig
from diffphys_ros.bags.thinned import chosen, said
from diffphys_ros.errors import InputError
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip

from .beside import COLOUR_INFO, DEPTH_INFO
from .clip_checks import labels_of
from .clip_topics import Plain, clip_messages, ending, frame, opening, slot_stamps
from .convert import stamp_ns
from .intake import Intake, Size, Taken, size_of

SOURCE = "raw topics"


class Sent(NamedTuple):
    """A clip that is out."""

    frames: int
    period_s: float
    notes: list[str]
    with_depth: bool


class Ready(NamedTuple):
    """A clip whose images are still to be decoded, but for the first."""

    rig: Rig
    kept: list[Taken]
    first: Taken
    pixels: np.ndarray  # of the first
    depths: list[Any]
    lost: list[str]


def ready(intake: Intake, settings: config.Settings) -> Ready:
    """Raises InputError where there is no clip in it, NotYetError where what is heard beside the images may still complete it."""
    size, kept, lost = _of_one_size(intake)
    total, every = len(kept), settings.frames.every
    kept = [kept[i] for i in chosen([image.stamp for image in kept], every, SOURCE)]
    lost += said(every, len(kept), total)
    first, pixels = _first_that_can_be_read(kept, intake)
    depths = [] if settings.topics.depth == "none" else _depths_of(intake)
    return Ready(Rig(_received(intake, kept, depths, size, settings), settings), kept, first, pixels, depths, lost)


def messages_of(intake: Intake, settings: config.Settings, made: Ready | None = None) -> Generator[Plain, None, Sent]:
    """The messages of a clip, in an order in which a listener can take them. What was handed over is let go.

    Raises InputError where there is no clip in it, before the first message.
    """
    rig, kept, first, pixels, depths, lost = made or ready(intake, settings)
    period_s, clock = _clock(kept, first.size)
    slop_s = period_s / 2 if settings.sync.slop_s is None else settings.sync.slop_s
    paired = said_of_pairs(np.array([_apart(depths, image.stamp) for image in kept]), slop_s, period_s, SOURCE) if depths else []
    masks = [(stamp_ns(m), labels_of(m, "mask")) for m in intake.masks]
    mask = min(masks, key=lambda item: abs(item[0] - first.stamp))[1] if masks else None
    name, deep = intake.beside.name(intake.topic), intake.beside.name(intake.depth_topic)
    pose = _single(intake, rig)
    intake.begin()
    yield from opening(rig.camera, first.stamp, None if mask is None else rig.labels(mask), pose, rig.gravity)
    stamps: list[int] = []
    while kept:
        image = kept.pop(0)
        try:
            pixels = decoded(image.message, SOURCE, name, colour=True) if image is not first else pixels
        except InputError as error:
            lost.append(f"an image was left out: {error}")
            continue
        depth = _depth_at(depths, image.stamp, slop_s, rig, deep) if depths else None
        yield from frame(rig.camera, image.stamp, rig.colour(image.stamp, pixels), depth)
        stamps.append(image.stamp)
    yield from ending(rig.camera, stamps, with_depth=bool(depths))
    return Sent(len(stamps), period_s, [*lost, *rig.notes, *clock, *paired], bool(depths))


def messages_of_clip(clip: Clip) -> Generator[Plain, None, Sent]:
    """The messages of a clip that was read from a recording."""
    yield from clip_messages(clip, slot_stamps(clip))
    return Sent(len(clip), clip.period_s, list(clip.notes), clip.depth is not None)


def _of_one_size(intake: Intake) -> tuple[Size, list[Taken], list[str]]:
    """The most common size, the images of it, and a note on the others."""
    size = Counter(image.size for image in intake.images).most_common(1)[0][0]
    kept = [image for image in intake.images if image.size == size]
    others = len(intake.images) - len(kept)
    return size, kept, [f"{others} of {len(intake.images)} images were left out (another size than {size[0]}x{size[1]} px)"] if others else []


def _first_that_can_be_read(kept: list[Taken], intake: Intake) -> tuple[Taken, np.ndarray]:
    """The first image of a clip and its pixels; those before it, which cannot be decoded, are dropped from the list."""
    count, reason, name = len(kept), "", intake.beside.name(intake.topic)
    while kept:
        try:
            pixels = decoded(kept[0].message, SOURCE, name, colour=True)
        except InputError as error:
            reason = str(error)
            kept.pop(0)
            continue
        if pixels.ndim != 3:
            raise InputError(f"{SOURCE}: topic {name} holds depth, must hold colour; publish depth on the topic depth")
        return kept[0], pixels
    raise InputError(f"{SOURCE}: none of {count} images can be read; {reason}")


def _received(intake: Intake, kept: list[Taken], depths: list[Any], size: Size, settings: config.Settings) -> Received:
    """What is known by now beside the images. Raises InputError where the only camera_info that came was refused."""
    beside, stamps, infos = intake.beside, [image.stamp for image in kept], intake.beside.infos(COLOUR_INFO)
    if not infos and beside.unusable and settings.camera.fov_deg is None:
        raise InputError(f"{SOURCE}: {beside.unusable}")
    colour = Channel(beside.name(intake.topic), size, _frame_of([image.message for image in kept]), infos, beside.name(COLOUR_INFO))
    depth = None
    if depths:
        depth = Channel(beside.name(intake.depth_topic), size_of(depths[0]), _frame_of(depths), beside.infos(DEPTH_INFO), beside.name(DEPTH_INFO))
    imu = None if settings.topics.imu == "none" else beside.imu(min(stamps), max(stamps))
    return Received(SOURCE, stamps, colour, depth, beside.transforms, imu)


def _frame_of(some: list[Any]) -> str:
    """The first frame that messages name."""
    return next((message.header.frame_id for message in some if message.header.frame_id), "")


def _single(intake: Intake, rig: Rig) -> dict[str, Any] | None:
    """The camera's transform as a plain message where it is the whole chain; a product of several has no exact quaternion."""
    link = intake.beside.transforms.single(rig.camera.frame_id, rig.camera.world_frame_id)
    if link is None:
        return None
    t, r = link.transform.translation, link.transform.rotation
    return {
        "header": messages.header(stamp_ns(link), link.header.frame_id),
        "child_frame_id": link.child_frame_id,
        "transform": {"translation": {"x": t.x, "y": t.y, "z": t.z}, "rotation": {"x": r.x, "y": r.y, "z": r.z, "w": r.w}},
    }


def _clock(kept: list[Taken], size: Size) -> tuple[float, list[str]]:
    """The frames' period [s] and notes. Raises InputError where they are too many, too large or follow no clock."""
    check_extent(len(kept), len(kept) * size[0] * size[1], SOURCE)
    if max(size) > MOST_SIDE:
        raise InputError(f"{SOURCE}: the images have {size[0]}x{size[1]} px, may have {MOST_SIDE} px a side; record smaller images")
    _, period_s, notes = uniform_clock(np.array([image.stamp for image in kept], np.int64), SOURCE)
    return period_s, notes


def _depths_of(intake: Intake) -> list[Any]:
    """The depth images of the most common size, in the order of their stamps."""
    if not intake.depths:
        return []
    sizes = [size_of(message) for message in intake.depths]
    usual = Counter(sizes).most_common(1)[0][0]
    return sorted((message for message, size in zip(intake.depths, sizes, strict=True) if size == usual), key=stamp_ns)


def _nearest(depths: list[Any], stamp: int) -> Any:
    return min(depths, key=lambda message: abs(stamp_ns(message) - stamp))


def _apart(depths: list[Any], stamp: int) -> float:
    """From a stamp [ns] to the nearest depth image [s]."""
    return abs(stamp_ns(_nearest(depths, stamp)) - stamp) * 1e-9


def _depth_at(depths: list[Any], stamp: int, slop_s: float, rig: Rig, topic: str) -> np.ndarray:
    """Depth (H, W) [m] at a stamp, 0 where it is unknown or there is none within slop_s."""
    best = _nearest(depths, stamp)
    if abs(stamp_ns(best) - stamp) * 1e-9 > slop_s:
        return np.zeros((rig.camera.height, rig.camera.width), np.float32)
    return rig.depth(stamp_ns(best), decoded(best, SOURCE, topic))
