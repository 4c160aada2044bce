"""Video files and folders of images: frames without depth, camera_info or stamps."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from diffphys_ros.bags.assemble import MOST_FRAMES, Bounded, Stamped, assemble, check_extent
from diffphys_ros.bags.camera import ASSUMED_FOV_DEG, camera_from_fov
from diffphys_ros.bags.decode import decode_compressed
from diffphys_ros.bags.storage import BAG_SUFFIXES, existing
from diffphys_ros.bags.thinned import chosen, said
from diffphys_ros.bags.world import told_of_world
from diffphys_ros.config import FrameSettings, Settings
from diffphys_ros.errors import InputError, listed, named, shown
from diffphys_ros.types import Clip

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
FRAME_RATES = (0.1, 1e5)  # Hz, that a video may state
EVEN = 0.25  # of a period that a frame's own time may be off an even clock: a container that counts in milliseconds rounds by less [chosen]
LEAST_DECODED = 0.9  # of the frames that a video announces: containers that estimate their number are off by a few
PROBE_BYTES = 4096  # without a zero byte, a file is text
MOST_PICTURE_BYTES = 256 << 20
JPEG_MAGIC, JPEG_SCAN, JPEG_END = b"\xff\xd8", b"\xff\xda", b"\xff\xd9"  # OpenCV 4 fills what is cut off with grey


def read_video(path: Path, settings: Settings, frames: FrameSettings | None = None) -> Clip:
    """The clip in a video file that OpenCV can decode; camera.fps overrides the file's own rate and times. Raises InputError."""
    every = 1 if frames is None else frames.every
    stamps, notes = stamps_of(path, settings.camera.fps, MOST_FRAMES * every + 1)
    taken, images = chosen(stamps, every, shown(path)), Bounded(shown(path))
    for k, picture in zip(taken, video_frames(path, set(taken)), strict=False):
        images.add(stamps[k], picture)
    clip = _clip(images.taken, settings, shown(path), frames)
    announced = _stated(path, cv2.CAP_PROP_FRAME_COUNT)
    notes += said(every, len(images.taken), round(announced) if announced > 0 else len(stamps))
    if len(stamps) < LEAST_DECODED * announced:
        notes.append(f"{len(stamps)} of the {announced:.0f} frames that the video announces can be decoded: it is cut off or damaged")
    return replace(clip, notes=(*clip.notes, *notes))


def stamps_of(path: Path, fps: float | None = None, most: int | None = None) -> tuple[list[int], list[str]]:
    """When the frames of a video are shown [ns], the first at 0, `most` at most, and what is to be said of that; `fps` overrides the file's own rate
    and times. Raises InputError."""
    rate = fps or _stated(path, cv2.CAP_PROP_FPS)
    low, high = FRAME_RATES
    if not low <= rate <= high:
        raise InputError(f"{shown(path)}: the video states {rate:.4g} frames a second, must be between {low:g} and {high:g}; set camera.fps")
    shown_ms = _shown_ms(path, most)
    if fps is not None or not _uneven(shown_ms, rate):
        return [round(k * 1e9 / rate) for k in range(len(shown_ms))], []
    apart = np.diff(shown_ms)
    note = f"the video's frames are {apart.min():.3g} to {apart.max():.3g} ms apart: each is taken at its own time; camera.fps overrides that"
    return [round(1e6 * ms) for ms in shown_ms - shown_ms[0]], [note]


def video_frames(path: Path, kept: Container[int] | None = None) -> Iterator[np.ndarray]:
    """The frames of a video file, or those of them whose numbers are `kept`, RGB uint8 (H, W, 3), one after the other. Raises InputError where
    there is none."""
    for k, capture in enumerate(_grabbed(path)):
        if kept is None or k in kept:
            got, frame = capture.retrieve()
            if not got:
                return
            yield np.ascontiguousarray(frame[..., ::-1])


def _grabbed(path: Path) -> Iterator[cv2.VideoCapture]:
    """A video at each of its frames. Raises InputError where there is none."""
    capture, count = _opened(path), 0
    try:
        while capture.grab():
            yield capture
            count += 1
    finally:
        capture.release()
    if not count:
        raise _no_video(path)


def _shown_ms(path: Path, most: int | None) -> np.ndarray:
    """When the frames of a video, `most` at most, are shown [ms], as its container tells."""
    return np.array([capture.get(cv2.CAP_PROP_POS_MSEC) for capture in islice(_grabbed(path), most)])


def _uneven(shown_ms: np.ndarray, fps: float) -> bool:
    """Whether the frames are shown one after the other, but not at `fps`: phones leave out frames, and slow down in dim light."""
    off = (shown_ms - shown_ms[0]) * fps / 1e3 - np.arange(len(shown_ms))
    return bool((np.diff(shown_ms) > 0).all() and np.abs(off).max() > EVEN)


def _opened(path: Path) -> cv2.VideoCapture:
    """An open video; no text file, which FFmpeg takes for a playlist, waiting for or opening whatever that names."""
    try:
        with existing(path).open("rb") as file:
            text = b"\0" not in file.read(PROBE_BYTES)
    except OSError as error:
        raise InputError(f"{shown(path)}: {error.strerror or error}; give a file that can be read") from error
    capture = cv2.VideoCapture() if text else cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise _no_video(path)
    return capture


def _no_video(path: Path) -> InputError:
    return InputError(f"{shown(path)}: holds no video that can be decoded; give an .mcap file, a rosbag2 folder, an .mp4 or a folder of images")


def _stated(path: Path, what: int) -> float:
    """A number of a video's header."""
    capture = _opened(path)
    try:
        return float(capture.get(what))
    finally:
        capture.release()


def read_images(path: Path, settings: Settings, frames: FrameSettings | None = None) -> Clip:
    """The clip in a folder of .png or .jpg images, in the order of the numbers in their names. Raises InputError."""
    files = image_files(path)
    if bags := sorted(f.name for f in path.iterdir() if f.suffix in BAG_SUFFIXES):
        raise InputError(f"{shown(path)}: a folder that holds recordings ({listed(bags)}) and no metadata.yaml; give one of them, or the folder to 'diffphys batch'")
    if not files:
        raise InputError(f"{shown(path)}: a folder without metadata.yaml (a rosbag2 folder) and without .png or .jpg images; give one of these")
    if settings.camera.fps is None:
        raise InputError(f"{shown(path)}: images in a folder state no frame rate; set camera.fps")
    every = 1 if frames is None else frames.every
    taken = files[::every]
    check_extent(len(taken), 0, shown(path))
    clip = _clip(_stamped(map(read_image, taken), settings.camera.fps / every, shown(path)), settings, shown(path), frames)
    return replace(clip, notes=(*clip.notes, *said(every, len(taken), len(files))))


def image_files(folder: Path) -> list[Path]:
    """The .png and .jpg files of a folder in the order of the numbers in their names. Raises InputError where it cannot be listed."""
    try:
        return sorted((f for f in folder.iterdir() if f.suffix.lower() in IMAGE_SUFFIXES), key=natural_order)
    except OSError as error:
        raise InputError(f"{shown(folder)}: {error.strerror or error}; give a folder that can be read") from error


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Key by which frame2 comes before frame10."""
    return [(int(number or 0), text) for text, number in re.findall(r"(\D*)(\d*)", path.name)]


def read_image(path: Path) -> np.ndarray:
    """The 8-bit RGB image (H, W, 3) of a .png or .jpg file. Raises InputError."""
    if not path.is_file() or path.stat().st_size > MOST_PICTURE_BYTES:
        raise InputError(f"{shown(path)}: no regular file of at most {MOST_PICTURE_BYTES >> 20} MiB; remove it or give a picture")
    try:
        data = path.read_bytes()
        image = decode_compressed(path.suffix.lower().lstrip("."), data)
    except InputError as error:
        raise InputError(f"{shown(path)}: {error}") from error
    except OSError as error:
        raise InputError(f"{shown(path)}: {error.strerror or error}; give a picture that can be read") from error
    except cv2.error as error:
        raise InputError(f"{shown(path)}: no picture that can be decoded ({named(error.err)}); give another .png or .jpg") from error
    if data.startswith(JPEG_MAGIC) and data.rfind(JPEG_END) < data.rfind(JPEG_SCAN):
        raise InputError(f"{shown(path)}: a picture that ends too soon; copy it again, or remove it")
    if image.ndim == 2:
        raise InputError(f"{shown(path)}: a 16-bit image, 8 bits a channel are needed; convert it")
    return image


def _stamped(pictures: Iterable[np.ndarray], fps: float, source: str) -> Stamped:
    images = Bounded(source)
    for k, picture in enumerate(pictures):
        images.add(round(k * 1e9 / fps), picture)
    return images.taken


def _clip(images: Stamped, settings: Settings, source: str, frames: FrameSettings | None) -> Clip:
    fov_deg, told = settings.camera.fov_deg, told_of_world(settings.scene)
    notes = [] if fov_deg else [f"no field of view was given: {ASSUMED_FOV_DEG:g} degrees are assumed (camera.fov_deg)"]
    if told and not settings.scene.target_frame:
        notes.append(f"pictures carry no transforms: {listed(told, 4)} is taken in the camera's own frame, x right, y down, z forward")
    height, width = images[0][1].shape[:2]
    camera = replace(camera_from_fov(fov_deg or ASSUMED_FOV_DEG, width, height), lens_told=bool(fov_deg))
    return assemble(images, [], camera, source, notes=notes, frames=frames)
