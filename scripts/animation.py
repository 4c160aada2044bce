#!/usr/bin/env python3
"""A recovery as a small moving picture: input | render with arrows of the force | stiffness of the particles, which move as recovered.

    python scripts/animation.py RESULT CLIP --out docs/figures/animation.gif

RESULT is a folder that `diffphys recover` wrote, CLIP the recording it came from. `make animation` recovers the bundled clips first."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.quiver import Quiver
from matplotlib.text import Text
from PIL import Image
from scipy.spatial import cKDTree

from diffphys_ros import config, result
from diffphys_ros.bags.read import read_clip
from diffphys_ros.colours import pascals, ramp, stiffness_colours, stiffness_range
from diffphys_ros.errors import InputError
from diffphys_ros.types import Camera, Clip, Recovery

WIDTH_IN, TOP_IN, BOTTOM_IN, DPI = 7.8, 0.27, 0.34, 100
SLOWER = 2.0  # times slower than the recording
HOLD_S = 0.8  # of the last frame
MARGIN_PX = 14  # around the object's path through the image
ARROWS, ARROW_SHARE = 14, 0.3  # how many; length of the largest, as a share of the object's size
COLOURS = 96  # of the palette that all pictures share
YELLOW, GREY = "#ffd23f", "#333333"
TEXT: dict[str, Any] = {"fontsize": 8.5, "color": GREY}
ARROW: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.011, "edgecolor": "#222222", "linewidth": 0.6, "minlength": 0, "minshaft": 1.5}
DOT: dict[str, Any] = {"edgecolors": "#ffffff66", "linewidths": 0.3}


@dataclass(frozen=True)
class Drawing:
    """What changes from frame to frame."""

    figure: Figure
    clip: Clip
    recovery: Recovery
    images: tuple[AxesImage, AxesImage]  # input, render
    arrows: Quiver
    tails: np.ndarray  # of the arrows [px], shape (T, K, 2)
    heads: np.ndarray  # [px], shape (T, K, 2)
    particles: PathCollection
    words: tuple[Text, Text]  # below the first two panels: time, net force

    def show(self, frame: int) -> Image.Image:
        """The picture of a frame."""
        shown = self.recovery.frames
        assert shown is not None
        for image, frames in zip(self.images, (self.clip.frames, shown), strict=True):
            image.set_data(frames[frame])
        self.arrows.set_offsets(self.tails[frame])
        self.arrows.set_UVC(*(self.heads[frame] - self.tails[frame]).T)
        pixels, depth = self.clip.camera.project(self.recovery.trajectory[frame].astype(float))
        order = np.argsort(-depth)
        self.particles.set_offsets(pixels[order])
        self.particles.set_facecolor([tuple(colour) for colour in stiffness_colours(_known(self.recovery))[order] / 255.0])
        time, force = self.words
        time.set_text(f"{frame * self.clip.period_s:.2f} s, at 1/{SLOWER:g} of its speed")
        if self.recovery.force_identified:
            force.set_text(f"net force {np.linalg.norm(self.recovery.net_force()[frame]):.1f} N")
        canvas = FigureCanvasAgg(self.figure)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())


def carriers(recovery: Recovery, camera: Camera, count: int = ARROWS) -> np.ndarray:
    """Free particles that the camera sees first and that lie far apart: indices, shape (K,), K <= count."""
    pixels, depth = camera.project(recovery.points)
    apart = np.median(np.cbrt(recovery.volume))
    beside = cKDTree(pixels).query_ball_point(pixels, apart * camera.focal_px / np.median(depth))
    front = np.array([depth[near].min() for near in beside])
    free = np.flatnonzero((depth < front + apart / 2) & ~recovery.clamped)
    chosen = [int(np.argmax(np.linalg.norm(pixels[free] - pixels[recovery.clamped].mean(0), axis=1))) if recovery.clamped.any() else 0]
    far = np.full(len(free), np.inf)
    while len(chosen) < min(count, len(free)):
        far = np.minimum(far, np.linalg.norm(pixels[free] - pixels[free[chosen[-1]]], axis=1))
        chosen.append(int(np.argmax(far)))
    return free[chosen]


def arrows(recovery: Recovery, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Tails and heads [px] of the arrows, (T, K, 2) each; the longest is ARROW_SHARE of the object, the others in proportion."""
    held = carriers(recovery, camera)
    at, force = recovery.trajectory[:, held].astype(float), recovery.force[:, held].astype(float)
    largest, size = np.linalg.norm(force, axis=2).max(), np.ptp(recovery.points, axis=0).max()
    return camera.project(at)[0], camera.project(at + force * (ARROW_SHARE * size / max(largest, 1e-30)))[0]


def window(recovery: Recovery, camera: Camera, heads: np.ndarray) -> tuple[tuple[float, float], tuple[float, float]]:
    """The part of the image through which object and arrows move: left and right, top and bottom [px]."""
    pixels = np.concatenate([camera.project(recovery.trajectory.astype(float))[0].reshape(-1, 2), heads.reshape(-1, 2)])
    low = np.maximum(pixels.min(0) - MARGIN_PX, -0.5)
    high = np.minimum(pixels.max(0) + MARGIN_PX, np.array([camera.width, camera.height]) - 0.5)
    return (low[0], high[0]), (low[1], high[1])


def drawing(recovery: Recovery, clip: Clip) -> Drawing:
    """The three panels, at frame 0. Raises InputError where the clip is another one than the result's."""
    if recovery.frames is None:
        raise InputError("result: holds no rendered frames; recover the clip again")
    if recovery.frames.shape != clip.frames.shape:
        raise InputError(f"clip: frames are {clip.frames.shape[:3]}, those of the result are {recovery.frames.shape[:3]}; name the clip that the result came from")
    tails, heads = arrows(recovery, clip.camera)
    (left, right), (top, bottom) = window(recovery, clip.camera, heads)
    figure, panels = _panels((bottom - top) / (right - left))
    for axes, title in zip(panels, ("input video", "render, recovered force", f"stiffness {_stiffness(recovery)}"), strict=True):
        axes.set_title(title, loc="left", pad=4, **TEXT)
    images = [axes.imshow(frames[0], interpolation="bilinear") for axes, frames in zip(panels, (clip.frames, recovery.frames), strict=False)]
    quiver = panels[1].quiver(*tails[0].T, *(heads - tails)[0].T, color=YELLOW, **ARROW)
    x, y = clip.camera.project(recovery.points)[0].T
    particles = panels[2].scatter(x, y, s=_dot(recovery, clip.camera, 72 * WIDTH_IN / 3 / (right - left)), **DOT)
    words = [axes.text(0, -0.02, "", transform=axes.transAxes, va="top", **TEXT) for axes in panels[:2]]
    _bar(figure, panels[2], recovery)
    for axes in panels:
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", facecolor="#f4f4f2")
    return Drawing(figure, clip, recovery, (images[0], images[1]), quiver, tails, heads, particles, (words[0], words[1]))


def write(path: Path, pictures: Iterator[Image.Image], period_s: float) -> Path:
    """All pictures as one GIF that repeats; they share one palette, so that nothing flickers."""
    shown = list(pictures)
    palette = _sheet(shown).quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
    small = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in shown]
    each_ms = round(1000 * period_s * SLOWER)
    path.parent.mkdir(parents=True, exist_ok=True)
    small[0].save(path, save_all=True, append_images=small[1:], duration=[each_ms] * (len(small) - 1) + [each_ms + round(1000 * HOLD_S)], loop=0, optimize=True)
    return path


def main(words: list[str] | None = None) -> int:
    """Writes the file; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", type=Path)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/figures/animation.gif"))
    parser.add_argument("--config", type=Path, action="append", default=[], help="settings without which the clip is not read as it was")
    options = parser.parse_args(words)
    try:
        recovery = result.load(options.result)
        clip = read_clip(options.clip, config.layered(options.config))
        shown = drawing(recovery, clip)
        path = write(options.out, (shown.show(frame) for frame in range(len(clip))), clip.period_s)
    except InputError as error:
        print(f"animation: {error}", file=sys.stderr)
        return 1
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    return 0


def _known(recovery: Recovery) -> np.ndarray:
    return np.where(recovery.identified[recovery.part - 1], recovery.young, np.nan)


def _stiffness(recovery: Recovery) -> str:
    young = _known(recovery)
    return ", ".join(pascals(float(np.median(young[recovery.part == part]))) for part in np.unique(recovery.part))


def _dot(recovery: Recovery, camera: Camera, points_per_px: float) -> float:
    """Area of a marker [points^2] so that neighbours touch."""
    across_px = np.median(np.cbrt(recovery.volume)) * camera.focal_px / np.median(camera.project(recovery.points)[1])
    return float(1.1 * across_px * points_per_px) ** 2


def _panels(height_by_width: float) -> tuple[Figure, list[Axes]]:
    """Three empty panels side by side, with room for a line of words above and below."""
    wide = WIDTH_IN / 3
    figure = Figure(figsize=(WIDTH_IN, round(wide * height_by_width + TOP_IN + BOTTOM_IN, 2)), dpi=DPI, facecolor="white")
    above, below = TOP_IN / figure.get_figheight(), BOTTOM_IN / figure.get_figheight()
    panels = [figure.add_axes((k / 3 + 0.004, below, 1 / 3 - 0.008, 1 - above - below)) for k in range(3)]
    for axes in panels:
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set_color("#cccccc")
    return figure, panels


def _bar(figure: Figure, axes: Axes, recovery: Recovery) -> None:
    """A small colour bar of E below the panel."""
    low, high = stiffness_range(_known(recovery))
    left, bottom, _, _ = axes.get_position().bounds
    inside = figure.add_axes((left + 0.08, 0.45 * bottom, 0.16, 0.3 * bottom))
    inside.imshow(ramp(np.linspace(0, 1, 64))[None], aspect="auto")
    inside.axis("off")
    for x, away, end in ((0, "right", low), (1, "left", high)):
        inside.text(x + (x - 0.5) * 0.06, 0.5, pascals(10**end), transform=inside.transAxes, ha=away, va="center", fontsize=7.5, color=GREY)


def _sheet(pictures: list[Image.Image]) -> Image.Image:
    """What the palette is made from: some of the pictures, and enough of the small coloured things that they keep their colours."""
    some = pictures[:: max(len(pictures) // 6, 1)]
    sheet = Image.new("RGB", (some[0].width, some[0].height * (len(some) + 1)), YELLOW)
    sheet.paste(Image.fromarray(ramp(np.linspace(0, 1, 32))[None]).resize((some[0].width, some[0].height // 2), Image.Resampling.NEAREST), (0, some[0].height * len(some)))
    for k, picture in enumerate(some):
        sheet.paste(picture, (0, k * picture.height))
    return sheet


if __name__ == "__main__":
    sys.exit(main())
