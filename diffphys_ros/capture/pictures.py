"""The pictures of the still object: gathered from a folder, a video or a recording as .png files of a bounded size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..bags.read import is_bag, read_clip
from ..bags.storage import existing
from ..bags.video import image_files, read_image, video_frames
from ..config import Settings
from ..errors import InputError, shown

LEAST_PICTURES = 6  # fewer do not go round an object
VIDEO_PICTURES = 60  # taken from a video or a recording where capture.every is 0
CLIP_NAME = "clip_frame_0.png"  # of the clip's first frame among the pictures


@dataclass(frozen=True)
class Picture:
    """One picture of the capture."""

    name: str  # of its .png file
    image: np.ndarray  # RGB, uint8, shape (H, W, 3)


def pictures_of(source: Path, settings: Settings) -> tuple[Iterator[Picture], np.ndarray | None]:
    """The pictures of a folder of images, every n-th frame of a video or of a recording's image topic, none larger than
    capture.max_side_px; and their intrinsic matrix (3, 3) [px] where the recording's camera_info knows it.

    Raises InputError, at the latest while they are read, where there are too few, or of different sizes.
    """
    if is_bag(existing(source)):
        clip = read_clip(source, settings)
        height, width = clip.frames.shape[1:3]
        factor = min(1.0, settings.capture.max_side_px / max(height, width))
        named = _numbered(iter(clip.frames), settings.capture.every or _step(len(clip)))
        return _checked(source, named, settings), resized(clip.camera.pixel_from_camera, factor)
    return _checked(source, _files(source) if source.is_dir() else _video(source, settings), settings), None


def resized(pixel_from_camera: np.ndarray, factor: float) -> np.ndarray:
    """The intrinsic matrix (3, 3) [px] of an image enlarged by a factor; pixel centres lie at integers."""
    matrix = pixel_from_camera * [[factor], [factor], [1.0]]
    matrix[:2, 2] += (factor - 1) / 2
    return matrix


def _checked(source: Path, named: Iterator[tuple[str, np.ndarray]], settings: Settings) -> Iterator[Picture]:
    size, count = None, 0
    for name, image in named:
        image = bounded(image, settings.capture.max_side_px)
        if size is not None and image.shape[:2] != size:
            raise InputError(
                f"{shown(source)}: {shown(name)} has {image.shape[1]}x{image.shape[0]} px, the pictures before it {size[1]}x{size[0]} px; "
                "give pictures of one camera, all upright or all on their side"
            )
        size, count = image.shape[:2], count + 1
        yield Picture(f"{name}.png", image)
    if count < LEAST_PICTURES:
        raise InputError(f"{shown(source)}: holds {count} pictures, needs at least {LEAST_PICTURES}; take more from all around the object, each overlapping the last")


def bounded(image: np.ndarray, max_side_px: int) -> np.ndarray:
    """The image (H, W, 3), smaller where its longer side exceeds the bound."""
    factor = max_side_px / max(image.shape[:2])
    if factor >= 1:
        return image
    return cv2.resize(image, (max(round(image.shape[1] * factor), 1), max(round(image.shape[0] * factor), 1)), interpolation=cv2.INTER_AREA)


def _files(folder: Path) -> Iterator[tuple[str, np.ndarray]]:
    files = image_files(folder)
    stems = [f.stem for f in files]
    return ((f.stem if stems.count(f.stem) == 1 else f.name.replace(".", "_"), read_image(f)) for f in files)


def _video(path: Path, settings: Settings) -> Iterator[tuple[str, np.ndarray]]:
    every = settings.capture.every or _step(sum(1 for _ in video_frames(path)))
    return _numbered(video_frames(path), every)


def _step(frames: int) -> int:
    return max(1, frames // VIDEO_PICTURES)


def _numbered(frames: Iterator[np.ndarray], every: int) -> Iterator[tuple[str, np.ndarray]]:
    return ((f"frame_{k:05d}", frame) for k, frame in enumerate(frames) if k % every == 0)

