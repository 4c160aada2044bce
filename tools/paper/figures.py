"""The paper's figures of a recovery, as PNG."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.spatial import cKDTree

from diffphys_ros.colours import stiffness_range
from diffphys_ros.inverse.material_prior import BELIEVED
from diffphys_ros.types import Clip, Recovery

from .pictures import moving
from .rows import young_moved_with

TIMES, ARROWS, ARROW_SHARE, DPI = 4, 60, 0.25, 100  # arrows a frame; the longest's share of the object's size
ACTS = 0.05  # of the largest mean force density from which a frame's is shown: else a clip that swings freely shows none
VIEWS = {"as the camera sees it": (0.0, 0.0), "60° to the side": (0.0, 60.0), "60° from above": (60.0, 20.0)}  # elevation and azimuth [deg] from the camera's side
DIFFERENCE_GAIN = 4
TITLES = {"force": "Figures 1 and 3. Force", "material": "Figures 1 and 4. Material", "slices": "Figure 5. Slices through space and time", "parts": "Figure A.2. Parts"}
CAPTIONS = {
    "force": "Force density at four of the times at which it acts; the longest arrow is as long as a quarter of the object.",
    "material": "Young's modulus with which the particles are simulated, at rest, corrected for the grid.",
    "slices": "One row of pixels, red in frame 0, over time: of the video, of the simulation and the difference of their colours.",
    "parts": "The particles of each part with their box, what is believed of their material, and why E is identified or not.",
}
WORDS_WIDTH = 120  # characters a line


def draw_all(folder: Path, recovery: Recovery, clip: Clip) -> None:
    """Writes the figures into a folder, a PNG each by the names of TITLES. The clip's frames are those of the recovery."""
    folder.mkdir(parents=True, exist_ok=True)
    made = {"force": force(recovery, clip), "material": material(recovery, clip), "parts": parts(recovery, clip)}
    if recovery.frames is not None:
        made["slices"] = slices(recovery.frames, clip.frames)
    for name, figure in made.items():
        figure.savefig(folder / f"{name}.png", dpi=DPI, bbox_inches="tight", facecolor="white", metadata={"Software": None})


def drawn(folder: Path) -> list[tuple[str, str, Path]]:
    """Title, caption and file of the figures that there are of all runs, one folder each, those of one kind together."""
    return [(f"{title}: {path.parent.name}", CAPTIONS[name], path) for name, title in TITLES.items() for path in sorted(folder.glob(f"*/{name}.png"))]


def force(recovery: Recovery, clip: Clip) -> Figure:
    """Arrows over the object at four times; colour is the force density's size [N/m^3]."""
    chosen = acting(recovery.force[: len(recovery.trajectory) - 1])
    few = cKDTree(recovery.points).query(_spaced(recovery.points), k=1)[1]
    size = np.linalg.norm(recovery.force[:, few], axis=2)
    largest = max(float(size[chosen].max()), 1e-30)
    length = ARROW_SHARE * float(np.ptp(recovery.points, axis=0).max()) / largest
    figure = Figure(figsize=(13, 3.6), layout="constrained")
    axes_row = figure.subplots(1, TIMES)
    for axes, k in zip(axes_row, chosen, strict=True):
        tails = recovery.trajectory[k, few].astype(float)
        (a, _), (b, _) = clip.camera.project(tails), clip.camera.project(tails + length * recovery.force[k, few])
        axes.imshow(clip.frames[k])
        arrows = axes.quiver(*a.T, *(b - a).T, size[k], angles="xy", scale_units="xy", scale=1, cmap="plasma", norm=Normalize(0, largest), width=0.007, edgecolor="white", linewidth=0.3)
        axes.set(xticks=[], yticks=[], title=f"{k * recovery.period_s:.2f} s")
    figure.colorbar(arrows, ax=axes_row, shrink=0.8, label="force density [N/m³]")
    figure.suptitle("" if recovery.force_identified else "force not identified: what the simulation ended with")
    return figure


def acting(force: np.ndarray) -> np.ndarray:
    """TIMES of the frames (T,) between the first and the last in which forces (T, P, 3) act, as far from each other as can be: of all where none acts, and
    TIMES in a row from the one before where too few act."""
    mean = np.linalg.norm(force, axis=2).mean(1)
    here = np.flatnonzero(mean >= ACTS * mean.max())
    first, last = int(here[0]), int(here[-1])
    if last - first < TIMES - 1:
        first = max(min(first - 1, len(force) - TIMES), 0)
        last = min(first + TIMES, len(force)) - 1
    return np.linspace(first, last, TIMES).round().astype(int)


def material(recovery: Recovery, clip: Clip) -> Figure:
    """log10 of Young's modulus, as simulated, on the particles from several views."""
    young = young_moved_with(recovery)
    low, high = stiffness_range(young)  # of all views
    across, down, along = _camera_axes(recovery.points, clip)
    figure = Figure(figsize=(13, 4), layout="constrained")
    all_axes = [figure.add_subplot(1, len(VIEWS), k + 1, projection="3d") for k in range(len(VIEWS))]
    for axes, (title, (elevation, azimuth)) in zip(all_axes, VIEWS.items(), strict=True):
        dots = axes.scatter(across, along, -down, c=np.log10(young), s=5, cmap="viridis", vmin=low, vmax=high)
        axes.view_init(elevation, azimuth - 90)
        axes.set(xticks=[], yticks=[], zticks=[], title=title)
        axes.set_box_aspect([max(float(np.ptp(values)), 1e-6) for values in (across, along, down)])  # type: ignore[attr-defined]
    figure.colorbar(dots, ax=all_axes, shrink=0.8, label="log10(E / Pa)")
    figure.suptitle("" if recovery.identified.all() else "E not identified: what the simulation ended with")
    return figure


def slices(rendered: np.ndarray, video: np.ndarray) -> Figure:
    """The image row that moves most, marked on frame 0, and over time: video, ours, their difference."""
    row = int(moving(video).sum(1).argmax())
    difference = np.clip(np.abs(video[:, row].astype(int) - rendered[:, row]) * DIFFERENCE_GAIN, 0, 255).astype(np.uint8)
    figure = Figure(figsize=(13, 3.2), layout="constrained")
    first, *others = figure.subplots(1, 4)
    first.imshow(video[0])
    first.axhline(row, color="red")
    first.set(xticks=[], yticks=[], title="frame 0")
    titles = ("video", "ours", f"difference × {DIFFERENCE_GAIN}")
    for axes, title, image in zip(others, titles, (video[:, row], rendered[:, row], difference), strict=True):
        axes.imshow(image, aspect="auto", interpolation="nearest")
        axes.set(title=title, xlabel=f"column of row {row} [px]", ylabel="frame")
    return figure


def parts(recovery: Recovery, clip: Clip) -> Figure:
    """Every part on frame 0, with its box and what was assumed or found of its material."""
    pixels = clip.camera.project(recovery.points)[0]
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots()
    axes.imshow(clip.frames[0])
    words = [note for note in recovery.notes if note.startswith(BELIEVED)]
    for number, reason in enumerate(recovery.reasons, 1):
        here = pixels[recovery.part == number]
        if not len(here):
            continue
        colour, (low, high) = f"C{number - 1}", (here.min(0), here.max(0))
        axes.scatter(here[:, 0], here[:, 1], s=1, color=colour, alpha=0.3)
        axes.add_patch(_box(low, high, colour))
        axes.text(low[0], low[1], f"part {number}", color=colour, fontsize=9, verticalalignment="bottom", bbox={"facecolor": "white", "edgecolor": colour, "pad": 1.5})
        words.append(f"part {number}: {reason}")
    axes.set(xticks=[], yticks=[])
    axes.set_xlabel("\n".join(textwrap.fill(line, WORDS_WIDTH) for line in words), fontsize=8, loc="left")
    return figure


def _box(low: np.ndarray, high: np.ndarray, colour: str) -> Rectangle:
    return Rectangle((low[0], low[1]), *(high - low), fill=False, edgecolor=colour)


def _spaced(points: np.ndarray) -> np.ndarray:
    """ARROWS points far from each other."""
    chosen, distance = [0], np.full(len(points), np.inf)
    while len(chosen) < min(ARROWS, len(points)):
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


def _camera_axes(points: np.ndarray, clip: Clip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Across the image, down it and along the line of sight [m]."""
    pixels, depth = clip.camera.project(points)
    metres = (pixels - pixels.mean(0)) * depth[:, None] / clip.camera.focal_px
    return metres[:, 0], metres[:, 1], depth
