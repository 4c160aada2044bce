"""A clip as the messages of a recording: what a robot's RGB-D camera would have published."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from diffphys_ros.bags.write import Message
from diffphys_ros.types import Camera
from tools.sample_maker.bar import FPS

START_NS = 1_750_000_000_000_000_000
FRAME_ID, WORLD = "camera_color_optical_frame", "world"


def clip_messages(camera: Camera, images: np.ndarray, depths: np.ndarray, *, effort: int = 1) -> Iterator[Message]:
    """Camera info, PNG colour (T, H, W, 3) and 16UC1 depth (T, H, W) [m] of every frame, and the camera's pose, as plain messages.

    `effort`: 0 to 9, of the compression: a file that is kept is worth ten times the time.
    """
    info = {
        "height": camera.height, "width": camera.width, "distortion_model": "plumb_bob", "d": np.zeros(5),
        "k": camera.pixel_from_camera, "r": np.eye(3), "p": np.c_[camera.pixel_from_camera, np.zeros(3)],
    }  # fmt: skip
    for k, (image, depth) in enumerate(zip(images, depths, strict=True)):
        ns = START_NS + round(k * 1e9 / FPS)
        header = {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": FRAME_ID}
        if k == 0:
            yield "/tf_static", "tf2_msgs/msg/TFMessage", ns, {"transforms": [_pose(camera, header["stamp"])]}, True
        yield "/camera/camera_info", "sensor_msgs/msg/CameraInfo", ns, {"header": header, **info}, False
        png = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, effort])[1]
        yield "/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", ns, {"header": header, "format": "png", "data": png}, False
        raw = {"height": camera.height, "width": camera.width, "encoding": "16UC1", "step": 2 * camera.width}
        raw["data"] = np.rint(depth * 1000).astype("<u2").tobytes()
        yield "/camera/depth/image_raw", "sensor_msgs/msg/Image", ns, {"header": header, **raw}, False


def _pose(camera: Camera, stamp: Any) -> dict[str, Any]:
    rotation = Rotation.from_matrix(camera.world_from_camera[:3, :3]).as_quat()
    return {
        "header": {"stamp": stamp, "frame_id": WORLD},
        "child_frame_id": FRAME_ID,
        "transform": {
            "translation": dict(zip("xyz", camera.position, strict=True)),
            "rotation": dict(zip("xyzw", rotation, strict=True)),
        },
    }
