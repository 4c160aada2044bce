"""A bundled clip made harder: what a recording shows in other light, from another camera, by another clock."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.bags.write import write_recording
from diffphys_ros.inpaint import scene_behind
from diffphys_ros.types import Camera, Clip
from tools.sample_maker.messages import clip_messages

FADES = (3, 10)  # frames between which the light on the object goes
LEFT = 0.6  # of it
PAN_PX = 0.3  # a frame
FINER, COLOURS = 4, ((70, 90, 150), (190, 110, 50))  # rows a pixel in which paint is drawn, and its colours
CUT, STUCK = slice(14, 22), slice(12, 18)  # frames that are missing under continuous stamps, and that show the one before

Shown = tuple[np.ndarray, np.ndarray]  # frames (T, H, W, 3) and depth (T, H, W) [m]


def in_fading_light(clip: Clip, truth: Path) -> Clip:
    """The clip with light that fades on the object, which a truth.npz tells from the room."""
    with np.load(truth) as told:
        mask = np.unpackbits(told["mask"])[: told["mask_shape"].prod()].reshape(told["mask_shape"]).astype(bool)
    light = np.interp(np.arange(len(clip)), FADES, (1.0, LEFT))[:, None, None, None]
    return replace(clip, frames=np.where(mask[..., None], (clip.frames * light).astype(np.uint8), clip.frames))


def panned(clip: Clip, px: float = PAN_PX) -> Shown:
    """Filmed by a camera that turns by `px` pixels a frame."""
    assert clip.depth is not None

    def moved(image: np.ndarray, k: int, how: int) -> np.ndarray:
        to = np.array([[1, 0, px * k], [0, 1, 0.0]])
        return np.asarray(cv2.warpAffine(image, to, image.shape[1::-1], flags=how, borderMode=cv2.BORDER_REPLICATE))

    frames, depths = (np.stack([moved(image, k, how) for k, image in enumerate(some)]) for some, how in ((clip.frames, cv2.INTER_CUBIC), (clip.depth, cv2.INTER_NEAREST)))
    return frames, depths


def painted(clip: Clip, truth: Path) -> np.ndarray:
    """Frames uint8 (T, H, W, 3) of a clip with parts of one colour each, drawn over the room where a truth.npz has them."""
    with np.load(truth) as told:
        tets, part, positions = told["tets"], told["tet_part"], told["positions"]
        mask = np.unpackbits(told["mask"])[: told["mask_shape"].prod()].reshape(told["mask_shape"]).astype(bool)
    room = scene_behind(clip.frames, ~mask)
    frames = []
    for at in positions:
        share = np.stack([_covered(clip.camera, at, tets[part == number]) for number in np.unique(part)])[..., None]
        shown = room.astype(float)
        for colour, by in zip(COLOURS, share, strict=True):
            shown += by * (np.array(colour) - shown)
        frames.append(np.rint(shown).astype(np.uint8))
    return np.stack(frames)


def _covered(camera: Camera, positions: np.ndarray, tets: np.ndarray) -> np.ndarray:
    """Share of each pixel (H, W) that tetrahedra of points (N, 3) [m] cover."""
    size = (camera.height * FINER, camera.width * FINER)
    corners = (camera.project(positions)[0] + 0.5) * FINER - 0.5
    canvas = np.zeros(size, np.uint8)
    for face in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)):
        for triangle in np.rint(16 * corners[tets[:, face]]).astype(np.int32):
            cv2.fillConvexPoly(canvas, triangle, 255, shift=4)
    return np.asarray(cv2.resize(canvas.astype(np.float32) / 255, (camera.width, camera.height), interpolation=cv2.INTER_AREA))


def cut(clip: Clip) -> Shown:
    """With frames missing."""
    assert clip.depth is not None
    return np.delete(clip.frames, CUT, 0), np.delete(clip.depth, CUT, 0)


def stuck(clip: Clip) -> Shown:
    """By a camera that hangs for a while."""
    assert clip.depth is not None
    frames = clip.frames.copy()
    frames[STUCK] = frames[STUCK.start - 1]
    return frames, clip.depth


def changed(source: Path, folder: Path, change: Callable[[Clip], Shown]) -> Path:
    """The clip of a bundled folder as `change` makes it; given.yaml and mask beside it."""
    clip = read_clip(source / "clip.mcap", config.Settings())
    frames, depth = change(clip)
    assert depth is not None
    write_recording(folder / "clip.mcap", clip_messages(clip.camera, frames, depth))
    for name in ("given.yaml", "mask0.png"):
        shutil.copy(source / name, folder / name)
    return folder
