"""How far the line that is found where an object meets what is still lies off the face by which it is truly held.

usage: python benchmarks/still_end.py SCENE...     (folders with clip.mcap, given.yaml and truth.npz; neither clamp nor depth is told)
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from diffphys_ros.bags.read import read_clip
from diffphys_ros.body.still_end import still_end
from diffphys_ros.config import layered
from diffphys_ros.inverse.prepare import label
from diffphys_ros.picture import extent_px
from diffphys_ros.types import Clip, object_mask

FRONT = 0.2  # of the depth of the held nodes, that the camera may see


def labelled(folder: Path) -> Clip:
    """A scene's clip by its colour images alone."""
    settings = layered([folder / "given.yaml"], {})
    settings = replace(settings, scene=replace(settings.scene, clamp_box_m=None))
    return label(replace(read_clip(folder / "clip.mcap", settings), depth=None), settings)


def off_px(clip: Clip, truth: Path, line: list[float]) -> float:
    """How far a line u v u v lies out of the object, beyond the held nodes that the camera sees [px]."""
    with np.load(truth) as told:
        nodes, held = told["positions"][0].astype(float), told["clamped"].astype(bool)
    pixels, depth = clip.camera.project(nodes)
    near = depth[held] <= depth[held].min() + FRONT * np.ptp(depth[held])
    end = pixels[held][near].mean(0)
    away = end - pixels[~held].mean(0)
    return float((np.reshape(line, (2, 2)).mean(0) - end) @ away / np.linalg.norm(away))


def main(*scenes: str) -> None:
    """A line for each scene, and the root mean square over the object's extent."""
    shares = []
    for folder in map(Path, scenes):
        clip = labelled(folder)
        line = still_end(clip)
        if line is None:
            print(f"{folder.name}: none is found")
            continue
        off, extent = off_px(clip, folder / "truth.npz", line), extent_px(object_mask(clip.labels[0]))  # type: ignore[index]
        shares.append(off / extent)
        print(f"{folder.name}: {off:+.1f} px, {shares[-1]:+.4f} of {extent:.0f} px", flush=True)
    print(f"root mean square {np.sqrt(np.mean(np.square(shares))):.4f}, median size {np.median(np.abs(shares)):.4f} of {len(shares)} scenes")


if __name__ == "__main__":
    main(*sys.argv[1:])
