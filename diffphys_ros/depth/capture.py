"""Surface depth from a capture of the still object from many sides, among whose pictures the clip's frame 0 found its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from .. import shapes, store
from ..config import Settings
from ..errors import InputError
from ..types import Camera, Clip, Thickness
from .scale import DepthSource
from .topic import fill_holes

FILE = "clip_view.npz"  # in the folder of a capture
_LINES = {
    "frame": "pixel H W 3", "distortion": "real 4", "depth": "real H W", "surface": "text", "scale": "text", "thickness_m": "gap", "thickness_axis": "real 3",
    "camera_width": "whole", "camera_height": "whole", "camera_frame_id": "text", "camera_world_frame_id": "text",
} | {f"camera_{name}": line for name, line in shapes.CAMERA.items()}  # fmt: skip
SAME_FRAME = 12.0  # grey levels: mean difference up to which a frame is the one that found its place


@dataclass(frozen=True)
class ClipView:
    """What a capture knows about frame 0 of a clip."""

    frame: np.ndarray  # frame 0 as the clip has it, RGB, uint8, shape (H, W, 3)
    camera: Camera  # in the clip's world
    distortion: np.ndarray  # of the clip's frames, OpenCV's k1 k2 p1 p2, shape (4,)
    depth: np.ndarray  # of the undistorted frame [m], 0 where unknown, float32, shape (H, W)
    surface: str  # how the depth was found, in words
    scale: str  # what fixed the metric scale, in words
    thickness_m: float  # extent of the object along thickness_axis; NaN where not measured
    thickness_axis: np.ndarray  # world, shape (3,)

    def arrays(self) -> dict[str, np.ndarray]:
        """Plain arrays by name, as FILE holds them."""
        return store.flat(self)


def read_clip_view(folder: str | Path) -> ClipView:
    """What the capture in a folder knows about its clip. Raises InputError where there is none, or it was made without a clip."""
    path = Path(folder) / FILE
    if not path.exists():
        raise InputError(f"depth.capture {folder}: holds no {FILE}; make it with 'diffphys capture IMAGES --clip CLIP --out {folder}'")
    arrays = store.read_arrays(path, "depth.capture", cure="make the capture again")
    try:
        return _view_of(arrays)
    except shapes.MisshapenError as error:
        raise InputError(f"depth.capture {path}: {error}; make the capture again") from error


def _view_of(arrays: Mapping[str, np.ndarray]) -> ClipView:
    """The inverse of ClipView.arrays. Raises shapes.MisshapenError for arrays that do not fit each other."""
    sizes = shapes.check(arrays, _LINES)
    view: ClipView = store.built(ClipView, arrays)
    shapes.check_camera(view.camera, sizes)
    shapes.require(np.isnan(view.thickness_m) or 0 < view.thickness_m < np.inf, "thickness_m must be > 0")
    return view


def registered(clip: Clip, settings: Settings) -> Clip:
    """The clip with the capture's camera and the thickness that it measured, and without lens distortion. Raises InputError where the capture was made with another clip."""
    view = _view(settings)
    _require_same(clip, view, settings)
    notes = [*clip.notes, f"camera of the capture {settings.depth.capture}"]
    if view.distortion.any():
        notes.append("lens distortion, as the capture found it, was removed from the images")
    thickness = Thickness(view.thickness_m, view.thickness_axis) if np.isfinite(view.thickness_m) else None
    if thickness is not None and settings.scene.thickness_m is None:
        notes.append(f"thickness {1e3 * view.thickness_m:.3g} mm, measured by the capture")
    frames = undistorted(clip.frames, view.camera, view.distortion)
    return replace(clip, camera=view.camera, frames=frames, notes=tuple(notes), thickness=thickness)


def undistorted(frames: np.ndarray, camera: Camera, distortion: np.ndarray) -> np.ndarray:
    """Frames (T, H, W, 3) without lens distortion (OpenCV's k1 k2 p1 p2); the intrinsics stay."""
    if not distortion.any():
        return frames
    return np.stack([cv2.undistort(frame, camera.pixel_from_camera, distortion) for frame in frames])


def captured_depth(clip: Clip, mask: np.ndarray, settings: Settings) -> tuple[np.ndarray, DepthSource]:
    """Depth [m] (H, W) of the object's pixels as the capture has it, holes filled, and what fixed its scale.

    Raises InputError where depth.capture is not set, was made with another clip or knows no depth on the object.
    """
    view = _view(settings)
    if clip.frames[0].shape != view.frame.shape:
        raise _another(settings)
    known = np.where(mask, view.depth, 0.0)
    if not known.any():
        raise InputError(f"depth.capture {settings.depth.capture}: knows no depth on the object; take more pictures from near the clip's camera")
    return fill_holes(known, mask).astype(np.float32), DepthSource(view.surface, view.scale)


def _view(settings: Settings) -> ClipView:
    if settings.depth.capture is None:
        raise InputError("depth.source is 'capture' but depth.capture is not set; give the folder that 'diffphys capture' wrote")
    return read_clip_view(settings.depth.capture)


def _require_same(clip: Clip, view: ClipView, settings: Settings) -> None:
    first = clip.frames[0]
    if first.shape != view.frame.shape or np.abs(first.astype(float) - view.frame).mean() > SAME_FRAME:
        raise _another(settings)


def _another(settings: Settings) -> InputError:
    return InputError(f"depth.capture {settings.depth.capture}: was made with another clip; run 'diffphys capture' with --clip naming this one")
