"""A capture on disk: made in a folder beside its place, put there when it is whole."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import store
from ..errors import InputError, shown
from ..types import Camera
from .structure import PictureCamera

CAPTURE, SCENE, OBJECT, SPARSE = "capture.npz", "scene.ply", "object.ply", "sfm"
PICTURES, MODEL, DATABASE, STAMP = "pictures", "model", "features.db", "made_of.json"  # in SPARSE


@dataclass(frozen=True)
class Capture:
    """A still scene seen from many places, world frame: the clip's where there is a clip, else the first camera's."""

    names: tuple[str, ...]  # of the pictures that found their place
    cameras: tuple[Camera, ...]  # of the undistorted pictures
    points: np.ndarray  # sparse, [m] where the scale is known, shape (N, 3)
    colors: np.ndarray  # RGB, uint8, shape (N, 3)
    errors: np.ndarray  # mean reprojection error [px], shape (N,)
    error_px: float  # mean over all observations
    scale: str  # what fixed the metric scale, in words
    lost: tuple[str, ...]  # pictures that found no place
    gaussians: int = 0  # of scene.ply; 0: none were trained
    object_gaussians: int = 0  # of object.ply
    notes: tuple[str, ...] = ()  # one sentence each


def load(folder: str | Path) -> Capture:
    """The capture in a folder. Raises InputError where there is none."""
    return store.load(_whole(Path(folder)), [Capture, Camera])


def _whole(folder: Path) -> Path:
    try:
        if (folder / CAPTURE).is_file():
            return folder / CAPTURE
    except (OSError, ValueError):  # a name too long, or with a NUL
        pass
    raise InputError(f"capture {shown(folder)}: holds no {CAPTURE}; make one with 'diffphys capture IMAGES --out {shown(folder)}'")


def begin(out: Path) -> Path:
    """The folder in which a capture is made before it is put into its place; what an earlier run left there stays, and what the
    finished capture in `out` has of structure from motion is taken over.

    Raises InputError where `out` holds something else, or cannot be written.
    """
    work = out.with_name(out.name + ".part")
    try:
        if out.exists() and not (out / CAPTURE).exists() and (not out.is_dir() or any(out.iterdir())):
            raise InputError(f"--out {shown(out)}: exists and is no capture; name a new folder")
        work.mkdir(parents=True, exist_ok=True)
        if (out / SPARSE).exists() and not (work / SPARSE / STAMP).exists():
            shutil.rmtree(work / SPARSE, ignore_errors=True)
            shutil.copytree(out / SPARSE, work / SPARSE)
    except OSError as error:
        raise InputError(f"--out {shown(out)}: {error.strerror or error}; choose a folder that can be written") from error
    return work


def finish(work: Path, out: Path) -> None:
    """Puts a finished capture into its place."""
    old = out.with_name(out.name + ".old")
    shutil.rmtree(old, ignore_errors=True)
    if out.exists():
        out.rename(old)
    work.rename(out)
    shutil.rmtree(old, ignore_errors=True)


def stamp_of(folder: Path, lenses: Sequence[PictureCamera], settings: Mapping[str, Any]) -> str:
    """What a reconstruction was made of: pictures, cameras and settings, as text."""
    digest = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for lens in lenses for name in lens.names}
    known = [[lens.model, None if lens.pixel_from_camera is None else lens.pixel_from_camera.tolist()] for lens in lenses]
    return json.dumps({"pictures": digest, "lenses": known, "settings": dict(settings)}, sort_keys=True)


def is_made_of(sparse: Path, stamp: str) -> bool:
    """Whether a finished reconstruction in the folder was made of just this."""
    return (sparse / STAMP).exists() and (sparse / STAMP).read_text(encoding="utf-8") == stamp
