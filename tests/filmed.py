"""Known points seen by known cameras, as the topics of a driver: for recordings and, by the same messages, for live topics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

START_NS, PERIOD_NS, FRAMES = 1_700_000_000_000_000_000, 33_333_333, 6
WIDTH, HEIGHT = 160, 120
K = np.array([[140.0, 0, 83.5], [0, 150.0, 57.25], [0, 0, 1]])
COLOUR_FRAME, DEPTH_FRAME = "color_optical", "depth_optical"
IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
TREE, IMU, POSE = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Imu", "geometry_msgs/msg/TransformStamped"
ROLES = {  # topics of a recording -> what ingest_node calls them
    "/color/image_raw": "image", "/color/image_rect": "image", "/color/image_raw/compressed": "image/compressed", "/color/camera_info": "camera_info",
    "/depth/image_raw": "depth", "/depth/image_raw/compressedDepth": "depth/compressedDepth", "/depth/camera_info": "depth_camera_info",
    "/tf": "/tf", "/tf_static": "/tf_static", "/imu": "imu",
}  # fmt: skip
POINTS = np.array([[-0.35, -0.2, 1.0], [0.3, -0.22, 1.1], [0.28, 0.25, 0.9], [-0.25, 0.24, 1.05], [0.02, 0.03, 1.0]])  # [m], in the colour camera
Message = tuple[str, str, int, dict[str, Any], bool]
EYE = np.eye(4)


def stamp_of(k: float) -> int:
    return START_NS + round(k * PERIOD_NS)


def header(ns: int, frame_id: str) -> dict[str, Any]:
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": frame_id}


def spots(pixels: np.ndarray, size: tuple[int, int] = (WIDTH, HEIGHT), sd: float = 1.6) -> np.ndarray:
    """A picture, RGB, with a round spot of its own brightness at every pixel (N, 2)."""
    v, u = np.mgrid[: size[1], : size[0]]
    light = sum(np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * sd**2)) for x, y in pixels)
    return np.repeat(np.rint(20 + 200 * np.clip(light, 0, 1)).astype(np.uint8)[..., None], 3, 2)


def found(picture: np.ndarray, near: np.ndarray, reach: int = 6) -> np.ndarray:
    """Centres (N, 2) [px] of the spots of a picture nearest to pixels (N, 2)."""
    light = np.clip(picture[..., 0].astype(float) - 30, 0, None)
    centres = []
    for x, y in near:
        left, top = max(int(x) - reach, 0), max(int(y) - reach, 0)
        patch = light[top : top + 2 * reach + 1, left : left + 2 * reach + 1]
        v, u = np.mgrid[: patch.shape[0], : patch.shape[1]]
        centres.append(((patch * u).sum() / patch.sum() + left, (patch * v).sum() / patch.sum() + top))
    return np.array(centres)


def seen_by_opencv(points: np.ndarray, k: np.ndarray, d: Sequence[float], model: str) -> np.ndarray:
    """Pixels (N, 2) of points (N, 3) in a camera with a distortion, by OpenCV's own projection."""
    none = np.zeros(3)
    if model == "equidistant":
        return cv2.fisheye.projectPoints(points[:, None], none, none, k, np.array(d, float))[0].reshape(-1, 2)
    return cv2.projectPoints(np.ascontiguousarray(points), none, none, k, np.array(d, float))[0].reshape(-1, 2)


def image(ns: int, values: np.ndarray, encoding: str, frame_id: str = COLOUR_FRAME) -> dict[str, Any]:
    values = np.ascontiguousarray(values)
    return {
        "header": header(ns, frame_id), "height": values.shape[0], "width": values.shape[1], "encoding": encoding,
        "is_bigendian": 0, "step": values.nbytes // values.shape[0], "data": values.tobytes(),
    }  # fmt: skip


def colour(pictures: Sequence[np.ndarray] | np.ndarray, topic: str = "/color/image_raw", frames: int = FRAMES) -> Iterator[Message]:
    """One picture for all frames, or one each; a pixel in the corner counts them, for no two pictures of a camera are equal."""
    for k in range(frames):
        picture = np.array(pictures if isinstance(pictures, np.ndarray) else pictures[k])
        picture[0, 0, 0] = k
        yield topic, IMAGE, stamp_of(k), image(stamp_of(k), picture, "rgb8"), False


def depth(metres: Sequence[np.ndarray] | np.ndarray, late_ns: int = 0, frame_id: str = COLOUR_FRAME, frames: int = FRAMES) -> Iterator[Message]:
    for k in range(frames):
        each = metres if isinstance(metres, np.ndarray) else metres[k]
        ns = stamp_of(k) + late_ns
        yield "/depth/image_raw", IMAGE, ns, image(ns, np.asarray(each, np.float32), "32FC1", frame_id), False


def info(k: np.ndarray = K, topic: str = "/color/camera_info", ns: int = START_NS, frame_id: str = COLOUR_FRAME, **fields: Any) -> Message:
    plain = {"header": header(ns, frame_id), "width": WIDTH, "height": HEIGHT, "distortion_model": "plumb_bob", "d": np.zeros(5), "k": np.ravel(k)}
    return topic, INFO, ns, plain | fields, False


def link(parent: str, child: str, parent_from_child: np.ndarray, ns: int = START_NS) -> dict[str, Any]:
    """A TransformStamped."""
    t, q = parent_from_child[:3, 3], Rotation.from_matrix(parent_from_child[:3, :3]).as_quat()
    transform = {"translation": dict(zip("xyz", map(float, t), strict=True)), "rotation": dict(zip("xyzw", map(float, q), strict=True))}
    return {"header": header(ns, parent), "child_frame_id": child, "transform": transform}


def tree(*links: dict[str, Any], topic: str = "/tf_static") -> Message:
    stamp = links[0]["header"]["stamp"]
    return topic, TREE, stamp["sec"] * 10**9 + stamp["nanosec"], {"transforms": list(links)}, topic == "/tf_static"


def imu(force: Sequence[float], frame_id: str, count: int = 40, noise: float = 0.02, **fields: Any) -> Iterator[Message]:
    """A sensor that rests, its specific force [m/s^2] with noise."""
    rng = np.random.default_rng(0)
    for k in range(count):
        ns = START_NS + k * 5_000_000
        felt = dict(zip("xyz", map(float, np.array(force) + rng.normal(0, noise, 3)), strict=True))
        yield "/imu", IMU, ns, {"header": header(ns, frame_id), "linear_acceleration": felt, **fields}, False


def pose(x: float = 0, y: float = 0, z: float = 0, *, turn_deg: Sequence[float] = (0, 0, 0)) -> np.ndarray:
    """Rigid transform (4, 4) [m] that turns about x, then y, then z, then shifts."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    matrix[:3, 3] = x, y, z
    return matrix
