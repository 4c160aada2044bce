"""Bundled clips made harder: what a recording shows in other light."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.maker.messages import clip_messages
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording

LIGHT, PERIOD_FRAMES = 0.35, 7.3  # of the light on the object: largest change, and frames in which it comes and goes


def in_changing_light(source: Path, folder: Path) -> Path:
    """The clip of a bundled folder with light on the object, not on the room, that comes and goes; its truth and given.yaml beside it."""
    clip = read_clip(source / "clip.mcap", config.Settings())
    with np.load(source / "truth.npz") as truth:
        mask = np.unpackbits(truth["mask"])[: truth["mask_shape"].prod()].reshape(truth["mask_shape"]).astype(bool)
    gain = 1 + LIGHT * np.sin(2 * np.pi * np.arange(len(clip)) / PERIOD_FRAMES)
    lit = np.clip(clip.frames * gain[:, None, None, None], 0, 255).astype(np.uint8)
    folder.mkdir(parents=True, exist_ok=True)
    assert clip.depth is not None
    write_recording(folder / "clip.mcap", clip_messages(clip.camera, np.where(mask[..., None], lit, clip.frames), clip.depth))
    for name in ("given.yaml", "mask0.png", "truth.npz"):
        shutil.copy(source / name, folder / name)
    return folder
