"""Which topics of a bag are the colour images, the depth and the camera_info: by type and encoding, or as the settings say."""

from __future__ import annotations

from typing import Any

from diffphys_ros.bags.decode import decode_compressed, is_depth
from diffphys_ros.bags.storage import Bag
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError, listed, named

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
NONE = "none"  # setting that leaves a topic out


def choose_topics(bag: Bag, wanted: Topics, source: str) -> tuple[str, str | None, str | None]:
    """Names of the colour topic, of the depth topic (None: there is none, or it is not wanted) and of camera_info (None: there is none).

    A topic that the recording announces but that holds no message is taken as not there. Raises InputError where a named topic is
    missing or of another type, where two would do, where one has two types, and where no colour is found.
    """
    for topic in (t for t, kinds in bag.mixed.items() if kinds & {IMAGE, COMPRESSED, INFO}):
        next(bag.messages([topic]), None)  # says what is wrong
    encodings = {t: e for t in image_topics(bag) if t != wanted.mask and (e := _encoding(bag, t)) is not None}
    colour = [t for t, e in encodings.items() if e == "colour"]
    depth = [t for t, e in encodings.items() if e == "depth"]
    infos = [t for t, kind in bag.types.items() if kind == INFO and bag.first(t) is not None]
    image = _pick(bag, wanted.image, colour, list(encodings), "image", source)
    if image is None:
        unknown = [f"{t} ({e})" for t, e in encodings.items() if e not in ("colour", "depth")]
        seen = f"image topics of unknown encoding: {listed(unknown, 3)}" if unknown else f"topics: {listed(sorted(bag.types), 4) or 'none'}"
        raise InputError(f"{source}: no colour images found ({seen}); record sensor_msgs/Image or CompressedImage with rgb8, bgr8 or mono8")
    depth_topic = None if wanted.depth == NONE else _pick(bag, wanted.depth, depth, list(encodings), "depth", source)
    return image, depth_topic, _pick(bag, wanted.camera_info, _siblings(infos, image), infos, "camera_info", source)


def image_topics(bag: Bag) -> list[str]:
    """Topics whose type is that of images."""
    return [topic for topic, kind in bag.types.items() if kind in (IMAGE, COMPRESSED)]


def namespace(topic: str) -> str:
    """Where image transports put camera_info: /camera/color of /camera/color/image_raw/compressed."""
    base = topic.removesuffix("/compressed").removesuffix("/compressedDepth")
    return base.rsplit("/", 1)[0]


def _encoding(bag: Bag, topic: str) -> str | None:
    """'colour', 'depth' or the encoding that is neither, of the first image of a topic; None where it holds none."""
    message = bag.first(topic)
    if message is None:
        return None
    if bag.types[topic] == COMPRESSED:
        return _compressed_kind(message)
    depth = is_depth(message.encoding)
    return message.encoding if depth is None else ("depth" if depth else "colour")


def _compressed_kind(message: Any) -> str:
    # 'png' alone says neither colour nor depth: the picture itself does
    try:
        return "depth" if decode_compressed(message.format, message.data).ndim == 2 else "colour"
    except InputError:
        return str(message.format)


def _siblings(infos: list[str], image: str) -> list[str]:
    """The camera_info beside the images where there are several, as the image transport convention has it."""
    beside = [t for t in infos if namespace(t) == namespace(image)]
    return beside if len(infos) > 1 and beside else infos


def _pick(bag: Bag, wanted: str | None, found: list[str], allowed: list[str], setting: str, source: str) -> str | None:
    if wanted is not None:
        if wanted not in allowed:
            raise InputError(
                f"{source}: topics.{setting} is '{named(wanted)}', must be one of {listed(sorted(allowed), 4) or 'none (there are no such topics)'}"
            )
        return wanted
    if len(found) > 1:
        raise InputError(f"{source}: several topics could be the {setting}: {listed(sorted(found), 4)}; name one with topics.{setting}")
    return found[0] if found else None
