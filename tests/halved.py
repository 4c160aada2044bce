"""The bundled sample at half its width and height: the same motion, a quarter of the pixels, for tests of the machinery around a fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.bags.write import write_recording
from diffphys_ros.msg_schemas import messages
from diffphys_ros.types import Clip


def write(folder: Path) -> Path:
    """clip.mcap, given.yaml and mask0.png as in the sample's folder; returns `folder`."""
    sample = sample_folder()
    write_recording(folder / "clip.mcap", recorded(halved(read_clip(sample / "clip.mcap", config.build({})))))
    cv2.imwrite(str(folder / "mask0.png"), cv2.imread(str(sample / "mask0.png"), cv2.IMREAD_GRAYSCALE)[::2, ::2])
    (folder / "given.yaml").write_text((sample / "given.yaml").read_text())
    return folder


def halved(clip: Clip) -> Clip:
    """Every other pixel, colours smoothed before."""
    assert clip.depth is not None
    k = clip.camera.pixel_from_camera * np.array([[0.5], [0.5], [1.0]])
    camera = replace(clip.camera, pixel_from_camera=k, width=clip.camera.width // 2, height=clip.camera.height // 2)
    return replace(clip, frames=np.array([cv2.pyrDown(frame) for frame in clip.frames]), depth=clip.depth[:, ::2, ::2], camera=camera)


def recorded(clip: Clip) -> Iterator[tuple[str, str, int, dict, bool]]:
    """Messages as a driver records them."""
    assert clip.depth is not None
    yield "/tf_static", "tf2_msgs/msg/TFMessage", clip.start_ns, {"transforms": [messages.camera_pose(clip.start_ns, clip.camera)]}, True
    for k, (image, depth) in enumerate(zip(clip.frames, clip.depth, strict=True)):
        stamp = clip.start_ns + round(k * clip.period_s * 1e9)
        head = messages.header(stamp, clip.camera.frame_id)
        yield "/camera/camera_info", "sensor_msgs/msg/CameraInfo", stamp, messages.camera_info(head, clip.camera), False
        yield "/camera/image_raw", "sensor_msgs/msg/Image", stamp, messages.image(head, image, "rgb8"), False
        yield "/camera/depth/image_raw", "sensor_msgs/msg/Image", stamp, messages.image(head, depth, "32FC1"), False
