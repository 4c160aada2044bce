"""What ingest_node collected, as the messages of a clip; one image at a time is decoded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator
from typing import Any, NamedTuple

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.assemble import MOST_SIDE, check_extent, uniform_clock
from diffphys_ros.bags.read import decoded, edge, nearest, seen_through
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip

from .clip_checks import labels_of
from .clip_topics import Plain, clip_messages, ending, frame, opening, slot_stamps
from .convert import stamp_ns
from .intake import Intake, Size, Taken

SOURCE = "raw topics"


class Sent(NamedTuple):
    """A clip that is out."""

    frames: int
    period_s: float
    notes: list[str]


class View(NamedTuple):
    """How the images of a clip are seen."""

    camera: Camera
    undistort: Callable[[np.ndarray], np.ndarray] | None
    pose: dict[str, Any] | None  # of the camera as a plain TransformStamped where one was received
    notes: list[str]


def messages_of(intake: Intake, settings: config.Settings, pose_of: Callable[[dict[str, Any], str], dict[str, Any] | None]) -> Generator[Plain, None, Sent]:
    """The messages of a clip, in an order in which a listener can take them. What was handed over is let go.

    Raises InputError where there is no clip in it, before the first message.
    """
    size, kept, lost = _of_one_size(intake)
    first, pixels = _first_that_can_be_read(kept)
    view = _view(intake, settings, first, size, pose_of)
    period_s, clock = _clock(kept, size)
    depths = [] if settings.topics.depth == "none" else _depths_of(intake.depths, size)
    masks = [(stamp_ns(m), labels_of(m, "mask")) for m in intake.masks]
    mask = nearest(masks, first.stamp) if masks else None
    intake.begin()
    yield from opening(view.camera, first.stamp, mask if mask is None or not view.undistort else view.undistort(mask), view.pose)
    stamps: list[int] = []
    while kept:
        image = kept.pop(0)
        try:
            pixels = decoded(image.message, SOURCE, image.topic) if image is not first else pixels
        except InputError as error:
            lost.append(f"an image was left out: {error}")
            continue
        depth = _depth_at(depths, image.stamp, period_s, size) if depths else None
        seen = [view.undistort(each) if view.undistort and each is not None else each for each in (pixels, depth)]
        yield from frame(view.camera, image.stamp, seen[0], seen[1])  # type: ignore[arg-type]
        stamps.append(image.stamp)
    yield from ending(view.camera, stamps, with_depth=bool(depths))
    return Sent(len(stamps), period_s, [*lost, *view.notes, *clock])


def messages_of_clip(clip: Clip) -> Generator[Plain, None, Sent]:
    """The messages of a clip that was read from a recording."""
    yield from clip_messages(clip, slot_stamps(clip))
    return Sent(len(clip), clip.period_s, list(clip.notes))


def _of_one_size(intake: Intake) -> tuple[Size, list[Taken], list[str]]:
    """The most common size, the images of it, and a note on the others."""
    size = Counter(image.size for image in intake.images).most_common(1)[0][0]
    kept = [image for image in intake.images if image.size == size]
    others = len(intake.images) - len(kept)
    return size, kept, [f"{others} of {len(intake.images)} images were left out (another size than {size[0]}x{size[1]} px)"] if others else []


def _first_that_can_be_read(kept: list[Taken]) -> tuple[Taken, np.ndarray]:
    """The first image of a clip and its pixels; those before it, which cannot be decoded, are dropped from the list."""
    count, reason = len(kept), ""
    while kept:
        try:
            pixels = decoded(kept[0].message, SOURCE, kept[0].topic)
        except InputError as error:
            reason = str(error)
            kept.pop(0)
            continue
        if pixels.ndim != 3:
            raise InputError(f"{SOURCE}: topic {kept[0].topic} holds depth, must hold colour; publish depth on the topic depth")
        return kept[0], pixels
    raise InputError(f"{SOURCE}: none of {count} images can be read; {reason}")


def _view(intake: Intake, settings: config.Settings, first: Taken, size: Size, pose_of: Callable[..., Any]) -> View:
    info = intake.infos.get(size) or next(reversed(intake.infos.values()), None)
    if info is None and intake.unusable and settings.camera.fov_deg is None:
        raise InputError(f"{SOURCE}: {intake.unusable}")
    edges, frame_id = dict(edge(link) for link in intake.links.values()), first.message.header.frame_id
    camera, undistort, notes = seen_through(info, edges, settings, (*size, frame_id), SOURCE, image_topic=first.topic, info_topic="camera_info")
    return View(camera, undistort, pose_of(intake.links, camera.frame_id), notes)


def _clock(kept: list[Taken], size: Size) -> tuple[float, list[str]]:
    """The frames' period [s] and notes. Raises InputError where they are too many, too large or follow no clock."""
    check_extent(len(kept), len(kept) * size[0] * size[1], SOURCE)
    if max(size) > MOST_SIDE:
        raise InputError(f"{SOURCE}: the images have {size[0]}x{size[1]} px, may have {MOST_SIDE} px a side; record smaller images")
    _, period_s, notes = uniform_clock(np.array([image.stamp for image in kept], np.int64), SOURCE)
    return period_s, notes


def _depths_of(depths: list[Any], size: Size) -> list[Any]:
    """The depth images of a size; raises InputError where there are some, and none of it."""
    fitting = [message for message in depths if (message.width, message.height) == size]
    if depths and not fitting:
        raise InputError(
            f"{SOURCE}: a depth image has {depths[0].width}x{depths[0].height} px, must have the camera's {size[0]}x{size[1]} px; "
            "record depth registered to the colour camera, or set topics.depth to 'none'"
        )
    return sorted(fitting, key=stamp_ns)


def _depth_at(depths: list[Any], stamp: int, period_s: float, size: Size) -> np.ndarray:
    """Depth (H, W) [m] at a stamp, 0 where it is unknown or there is none within half a period."""
    best = min(depths, key=lambda message: abs(stamp_ns(message) - stamp))
    if abs(stamp_ns(best) - stamp) * 1e-9 > period_s / 2:
        return np.zeros((size[1], size[0]), np.float32)
    return decoded(best, SOURCE, "depth")
