"""Which topics of a bag are the colour images, the depth and the camera_info: by type and encoding, or as the settings say."""

from __future__ import annotations

from typing import Any

from diffphys_ros.bags.decode import decode_compressed, is_depth
from diffphys_ros.bags.storage import Bag
from diffphys_ros.config import Topics
from diffphys_ros.errors import InputError, listed, named

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
IMU = "sensor_msgs/msg/Imu"
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
    depth = [t for t, e in encodings.items() if e == "depth" and t != wanted.image]
    infos = [t for t, kind in bag.types.items() if kind == INFO and bag.first(t) is not None]
    image = _pick(bag, wanted.image, colour, list(encodings), "image", source)
    if image is None:
        unknown = [f"{t} ({e})" for t, e in encodings.items() if e not in ("colour", "depth")]
        seen = f"image topics of unknown encoding: {listed(unknown, 3)}" if unknown else f"topics: {listed(sorted(bag.types), 4) or 'none'}"
        raise InputError(f"{source}: no colour images found ({seen}); record sensor_msgs/Image or CompressedImage with rgb8, bgr8, yuv422 or a Bayer pattern")
    depth_topic = None if wanted.depth == NONE else _pick(bag, wanted.depth, depth, list(encodings), "depth", source)
    of_depth = {info for topic in depth if (info := depth_info(bag, topic, image))}
    found = _siblings([t for t in infos if t not in of_depth], image)
    return image, depth_topic, _pick(bag, wanted.camera_info, found, infos, "camera_info", source)


def depth_info(bag: Bag, depth: str | None, image: str) -> str | None:
    """The camera_info beside the depth images, where it is not that of the colour images; None where there is none."""
    if depth is None or namespace(depth) == namespace(image):
        return None
    infos = [t for t, kind in bag.types.items() if kind == INFO and namespace(t) == namespace(depth) and bag.first(t) is not None]
    return infos[0] if len(infos) == 1 else None


def choose_imu(bag: Bag, wanted: Topics, source: str) -> str | None:
    """The topic of an IMU; None where there is none, several, or none is wanted. Raises InputError where a named one is missing."""
    found = [topic for topic, kind in bag.types.items() if kind == IMU]
    if wanted.imu in (None, NONE):
        return found[0] if len(found) == 1 and wanted.imu is None else None
    return _pick(bag, wanted.imu, found, found, "imu", source)


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
