"""A bundled clip made harder: what a recording shows in other light."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.maker.messages import clip_messages
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording

FADES = (3, 10)  # frames between which the light on the object goes
LEFT = 0.6  # of it


def in_fading_light(source: Path, folder: Path) -> Path:
    """The clip of a bundled folder with light that fades on the object, not on the room; its truth and given.yaml beside it."""
    clip = read_clip(source / "clip.mcap", config.Settings())
    with np.load(source / "truth.npz") as truth:
        mask = np.unpackbits(truth["mask"])[: truth["mask_shape"].prod()].reshape(truth["mask_shape"]).astype(bool)
    light = np.interp(np.arange(len(clip)), FADES, (1.0, LEFT))[:, None, None, None]
    shown = np.where(mask[..., None], (clip.frames * light).astype(np.uint8), clip.frames)
    assert clip.depth is not None
    write_recording(folder / "clip.mcap", clip_messages(clip.camera, shown, clip.depth))
    for name in ("given.yaml", "mask0.png", "truth.npz"):
        shutil.copy(source / name, folder / name)
    return folder
