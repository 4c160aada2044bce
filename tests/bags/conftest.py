"""Small real recordings for the tests of this room."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from diffphys_ros.bags.write import write_recording

START_NS, PERIOD_NS = 1_700_000_000_000_000_000, 33_333_333
WIDTH, HEIGHT, FOCAL = 16, 12, 20.0
FRAME = "camera_optical"
Message = tuple[str, str, int, dict[str, Any], bool]


def header(ns: int) -> dict[str, Any]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": FRAME}


def image(ns: int, data: np.ndarray, encoding: str) -> dict[str, Any]:
    return {
        "header": header(ns),
        "height": data.shape[0],
        "width": data.shape[1],
        "encoding": encoding,
        "step": data.nbytes // data.shape[0],
        "data": data.tobytes(),
    }


def picture(k: int) -> np.ndarray:
    """A frame that no other frame equals, RGB."""
    return np.random.default_rng(k).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def distance(k: int) -> np.ndarray:
    """Depth of frame k [mm]."""
    return np.full((HEIGHT, WIDTH), 500 + k, np.uint16)


def colour_topic(topic: str = "/camera/image_raw", frames: int = 6, stamps: list[int] | None = None) -> Iterator[Message]:
    for k, ns in enumerate(stamps or [START_NS + k * PERIOD_NS for k in range(frames)]):
        yield topic, "sensor_msgs/msg/Image", ns, image(ns, picture(k), "rgb8"), False


def png_topic(topic: str = "/camera/image_raw/compressed", frames: int = 6) -> Iterator[Message]:
    for k in range(frames):
        ns = START_NS + k * PERIOD_NS
        png = cv2.imencode(".png", picture(k)[..., ::-1])[1].tobytes()
        yield topic, "sensor_msgs/msg/CompressedImage", ns, {"header": header(ns), "format": "png", "data": png}, False


def depth_topic(topic: str = "/camera/depth/image_raw", frames: int = 6, fill: float | None = None) -> Iterator[Message]:
    """16UC1 images, or 32FC1 ones filled with a value."""
    for k in range(frames):
        ns = START_NS + k * PERIOD_NS
        data = distance(k) if fill is None else np.full((HEIGHT, WIDTH), fill, np.float32)
        yield topic, "sensor_msgs/msg/Image", ns, image(ns, data, "16UC1" if fill is None else "32FC1"), False


def info_topic(topic: str = "/camera/camera_info", **fields: Any) -> Iterator[Message]:
    info = {"header": header(START_NS), "height": HEIGHT, "width": WIDTH, "distortion_model": "plumb_bob", "d": np.zeros(5)}
    info["k"] = [FOCAL, 0, (WIDTH - 1) / 2, 0, FOCAL, (HEIGHT - 1) / 2, 0, 0, 1]
    yield topic, "sensor_msgs/msg/CameraInfo", START_NS, info | fields, False


def tree_topic(links: Mapping[str, tuple[str, tuple[float, float, float]]]) -> Iterator[Message]:
    """/tf_static with translations: child -> (parent, xyz [m])."""
    transforms = [
        {
            "header": header(START_NS) | {"frame_id": parent},
            "child_frame_id": child,
            "transform": {"translation": dict(zip("xyz", xyz, strict=True))},
        }
        for child, (parent, xyz) in links.items()
    ]
    yield "/tf_static", "tf2_msgs/msg/TFMessage", START_NS, {"transforms": transforms}, True


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., Path]:
    """Writes topics into one MCAP file and returns its path."""

    def write(*topics: Iterator[Message]) -> Path:
        return write_recording(tmp_path / "clip.mcap", [message for topic in topics for message in topic])

    return write
