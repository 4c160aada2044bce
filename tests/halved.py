"""The bundled sample at half its width and height: the same motion, a quarter of the pixels, for tests of the machinery around a fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.sample import sample_folder
from diffphys_ros.bags.write import write_recording
from diffphys_ros.types import Clip
from tools.sample_maker.messages import clip_messages


def write(folder: Path, *, frames: int | None = None) -> Path:
    """clip.mcap, given.yaml and mask0.png as in the sample's folder, of the first `frames` where given; returns `folder`."""
    sample = sample_folder()
    clip = halved(read_clip(sample / "clip.mcap", config.build({})))
    write_recording(folder / "clip.mcap", clip_messages(clip.camera, clip.frames[:frames], clip.depth[:frames]))
    cv2.imwrite(str(folder / "mask0.png"), cv2.imread(str(sample / "mask0.png"), cv2.IMREAD_GRAYSCALE)[::2, ::2])
    (folder / "given.yaml").write_text((sample / "given.yaml").read_text())
    return folder


def halved(clip: Clip) -> Clip:
    """Every other pixel, colours smoothed before."""
    assert clip.depth is not None
    k = clip.camera.pixel_from_camera * np.array([[0.5], [0.5], [1.0]])
    camera = replace(clip.camera, pixel_from_camera=k, width=clip.camera.width // 2, height=clip.camera.height // 2)
    return replace(clip, frames=np.array([cv2.pyrDown(frame) for frame in clip.frames]), depth=clip.depth[:, ::2, ::2], camera=camera)
