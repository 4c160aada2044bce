"""Video files and folders of images: frames without depth, camera_info or stamps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from diffphys_ros.bags.assemble import assemble
from diffphys_ros.bags.camera import ASSUMED_FOV_DEG, camera_from_fov
from diffphys_ros.bags.decode import decode_compressed
from diffphys_ros.config import Settings
from diffphys_ros.errors import InputError
from diffphys_ros.types import Clip

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


def read_video(path: Path, settings: Settings) -> Clip:
    """The clip in a video file that OpenCV can decode; camera.fps overrides the file's own rate. Raises InputError."""
    frames = list(video_frames(path))
    fps = settings.camera.fps or _frame_rate(path)
    if not fps > 0:
        raise InputError(f"{path}: the video states no frame rate; set camera.fps")
    return _clip(frames, fps, settings.camera.fov_deg, str(path))


def video_frames(path: Path) -> Iterator[np.ndarray]:
    """The frames of a video file, RGB uint8 (H, W, 3), one after the other. Raises InputError where there is none."""
    capture, count = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG), 0
    try:
        while True:
            got, frame = capture.read()
            if not got:
                break
            yield np.ascontiguousarray(frame[..., ::-1])
            count += 1
    finally:
        capture.release()
    if not count:
        raise InputError(f"{path}: holds no video that can be decoded; give an .mcap file, a rosbag2 folder, an .mp4 or a folder of images")


def _frame_rate(path: Path) -> float:
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    try:
        return float(capture.get(cv2.CAP_PROP_FPS))
    finally:
        capture.release()


def read_images(path: Path, settings: Settings) -> Clip:
    """The clip in a folder of .png or .jpg images, in the order of the numbers in their names. Raises InputError."""
    files = sorted((f for f in path.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES), key=natural_order)
    if not files:
        raise InputError(f"{path}: a folder without metadata.yaml (a rosbag2 folder) and without .png or .jpg images; give one of these")
    if settings.camera.fps is None:
        raise InputError(f"{path}: images in a folder state no frame rate; set camera.fps")
    return _clip([read_image(f) for f in files], settings.camera.fps, settings.camera.fov_deg, str(path))


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Key by which frame2 comes before frame10."""
    return [(int(number or 0), text) for text, number in re.findall(r"(\D*)(\d*)", path.name)]


def read_image(path: Path) -> np.ndarray:
    """The 8-bit RGB image (H, W, 3) of a .png or .jpg file. Raises InputError."""
    try:
        image = decode_compressed(path.suffix.lower().lstrip("."), path.read_bytes())
    except (InputError, OSError) as error:
        raise InputError(f"{path}: {error}") from error
    if image.ndim == 2:
        raise InputError(f"{path}: a 16-bit image, 8 bits a channel are needed; convert it")
    return image


def _clip(frames: list[np.ndarray], fps: float, fov_deg: float | None, source: str) -> Clip:
    notes = [] if fov_deg else [f"no field of view was given: {ASSUMED_FOV_DEG:g} degrees are assumed (camera.fov_deg)"]
    height, width = frames[0].shape[:2]
    camera = camera_from_fov(fov_deg or ASSUMED_FOV_DEG, width, height)
    stamped = [(round(k * 1e9 / fps), frame) for k, frame in enumerate(frames)]
    return assemble(stamped, [], camera, source, notes=notes)
