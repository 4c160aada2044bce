"""A video as the topics of a camera that nobody calibrated: for nodes that listen to a camera."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from diffphys_ros.bags.rig import FRAME
from diffphys_ros.bags.video import stamps_of, video_frames
from diffphys_ros.bags.write import Message
from diffphys_ros.msg_schemas import messages
from diffphys_ros.msg_schemas.topics import CAMERA_INFO, IMAGE

IMAGE_TOPIC, INFO_TOPIC = "/camera/image_raw", "/camera/camera_info"
BEGIN_NS = 10**9  # of the first frame: a stamp of 0 is none


def topics_of_video(path: Path) -> Iterator[Message]:
    """Every frame of a video with its camera_info, whose K is 0: camera.fov_deg stands for the lens. Raises InputError for what is no video."""
    stamps, _ = stamps_of(path)
    for stamp, pixels in zip(stamps, video_frames(path), strict=False):
        head, (height, width) = messages.header(BEGIN_NS + stamp, FRAME), pixels.shape[:2]
        yield INFO_TOPIC, CAMERA_INFO, BEGIN_NS + stamp, {"header": head, "height": height, "width": width}, False
        yield IMAGE_TOPIC, IMAGE, BEGIN_NS + stamp, messages.image(head, pixels, "rgb8"), False
