"""One capture of the room that this folder's tests share."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from diffphys_ros.capture import Capture, reconstruct
from diffphys_ros.config import Settings, build
from diffphys_ros.progress import Progress
from diffphys_ros.types import Camera

from . import room

pytest.importorskip("pycolmap", reason="the extra [capture] is not installed")


@dataclass(frozen=True)
class Made:
    """A capture with its truth."""

    images: Path
    clip: Path
    out: Path
    settings: Settings
    cameras: list[Camera]  # of the pictures, in the order of their names
    clip_camera: Camera
    capture: Capture


def settings_of(**values: Any) -> Settings:
    """Settings of a small capture; further dotted ones with '__' for the dot."""
    known = {"topics.mask": "/mask", "capture.max_gaussians": 0, "capture.lens": "pinhole", "scene.thickness_axis": [0.0, 1.0, 0.0], "fit.device": "cpu"}
    return build(known | {name.replace("__", "."): value for name, value in values.items()})


def run(steps: Generator[Progress, None, Capture]) -> tuple[Capture, list[Progress]]:
    """What a generator returns, and the news on the way."""
    news = []
    try:
        while True:
            news.append(next(steps))
    except StopIteration as stop:
        return stop.value, news


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Nine pictures from 75 degrees left to 75 right of the front, and a recording from 8 degrees right of it."""
    folder = tmp_path_factory.mktemp("capture")
    cameras, clip_camera = room.around(9, 150.0), room.camera_from(8.0, 18.0)
    images = room.write_pictures(folder / "images", cameras)
    clip = room.write_clip(folder / "clip.mcap", clip_camera)
    settings = settings_of(capture__max_gaussians=2000, experiment__view_iterations=3)
    capture, _ = run(reconstruct(images, folder / "out", settings, clip))
    return Made(images, clip, folder / "out", settings, cameras, clip_camera, capture)
