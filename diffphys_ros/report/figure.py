"""The summary figure: input beside render, the material, the force over time. The one file that imports matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from ..colours import COMPONENTS, NET, in_words, pascals, ramp, stiffness_range
from ..types import Clip, Recovery, Scale

FRAMES = 4  # shown side by side
WIDTH_IN, PANELS_IN = 13.0, 4.0  # of the figure; height of the lower panels
HIGHEST_IN = 3.2  # of one row of images
MARGIN_PX = 12  # around the object's path through the image
ACTIVE_SHARE = 0.05  # frames above this share of the peak net force are shaded
_STYLE: dict[str, Any] = {"fontsize": 9, "color": "#333333"}


@dataclass(frozen=True)
class Truth:
    """What a known truth adds to the figure."""

    young: Sequence[float]  # by part [Pa]
    net_force: np.ndarray  # [N], shape (T, 3)


def summary(path: str | Path, recovery: Recovery, clip: Clip, *, truth: Truth | None = None, scale: Scale | None = None) -> Path:
    """Write the figure (PNG) of a recovery and the clip it came from, with a truth overlaid where one is given; in the recovery's own scale where no other is given."""
    scale = scale or recovery.scale
    window = _window(recovery, clip)
    above = _frames_height(recovery, clip.frames[0][window].shape)
    figure = Figure(figsize=(WIDTH_IN, above + PANELS_IN), layout="constrained")
    (top,), (bottom,) = figure.subfigures(2, 1, height_ratios=[above, PANELS_IN], hspace=0.03, squeeze=False)
    _draw_frames(top, recovery, clip, window)
    material, force = bottom.subplots(1, 2, width_ratios=[1, 1.25])
    _draw_material(material, recovery, clip, scale, truth)
    _draw_force(force, recovery, clip.period_s, scale, truth)
    figure.suptitle(_headline(recovery, scale), fontsize=12, color="#111111", x=0.01, ha="left", weight="bold")
    figure.savefig(path, dpi=110, facecolor="white", metadata={"Software": None})
    return Path(path)


def shown_frames(recovery: Recovery, count: int) -> list[int]:
    """`count` frames worth looking at: the first, then those of the largest displacement in equal stretches of the clip."""
    motion = np.linalg.norm(recovery.trajectory - recovery.trajectory[0], axis=2).mean(1)
    stretches = [s for s in np.array_split(np.arange(1, len(motion)), count - 1) if len(s)]
    return [0] + [int(s[np.argmax(motion[s])]) for s in stretches]


def _headline(recovery: Recovery, scale: Scale) -> str:
    quality = [
        f"{label} {recovery.metrics[key]:.1f} dB"
        for key, label in (("psnr_masked", "masked PSNR"), ("psnr_masked_frozen_frame", "frozen first frame"))
        if isinstance(recovery.metrics.get(key), float)
    ]
    return "   |   ".join([_parts_in_words(recovery, scale), _peak_in_words(recovery, scale), *quality])


def _peak_in_words(recovery: Recovery, scale: Scale) -> str:
    if not recovery.force_identified:
        return "force not identified"
    if scale.absolute:
        return f"peak net force {recovery.net_force_peak:.3g} ({recovery.net_force_peak_sd:.2g}) N"
    net, name, unit = recovery.net_quantity(scale)
    return f"peak {name} {np.linalg.norm(net, axis=1).max():.3g} {unit}" if unit else "force relative: no length is told"


def _parts_in_words(recovery: Recovery, scale: Scale) -> str:
    values, _ = _stiffness_by_part(recovery, scale)
    _, name, unit = recovery.stiffness(scale)
    return f"{name} = " + ", ".join(in_words(value, unit) for value in values)


def _stiffness_by_part(recovery: Recovery, scale: Scale) -> tuple[np.ndarray, np.ndarray]:
    """Medians by part of what a scale makes of the stiffness, NaN where not identified, and of the sd of its log10, NaN where it is a ratio of parts."""
    parts = [recovery.part == number for number in range(1, len(recovery.identified) + 1)]
    sd = recovery.log10_young_sd if scale.absolute else recovery.log10_specific_sd if scale.length else np.full(len(recovery.part), np.nan)
    return (
        np.array([np.median(recovery.stiffness(scale).values[here]) if here.any() else np.nan for here in parts]),
        np.array([np.median(sd[here]) if here.any() else np.nan for here in parts]),
    )


def _frames_height(recovery: Recovery, shape: tuple[int, ...]) -> float:
    """Height that the rows of images need [in], with their titles."""
    rows = 1 if recovery.frames is None else 2
    return 0.6 + rows * min(WIDTH_IN / FRAMES * shape[0] / shape[1] + 0.05, HIGHEST_IN)


def _draw_frames(figure: Figure, recovery: Recovery, clip: Clip, window: tuple[slice, slice]) -> None:
    frames = shown_frames(recovery, FRAMES)
    rows = [("input", clip.frames)] + ([("render", recovery.frames)] if recovery.frames is not None else [])
    grid = figure.subplots(len(rows), len(frames), squeeze=False)
    for axes_row, (name, images) in zip(grid, rows, strict=True):
        for axes, frame in zip(axes_row, frames, strict=True):
            axes.imshow(images[frame][window], interpolation="nearest")
            axes.set_xticks([])
            axes.set_yticks([])
            for spine in axes.spines.values():
                spine.set_color("#cccccc")
        axes_row[0].set_ylabel(name, **_STYLE)
    for axes, frame in zip(grid[0], frames, strict=True):
        axes.set_title(f"frame {frame}, {frame * clip.period_s:.2f} s", **_STYLE)


def _window(recovery: Recovery, clip: Clip) -> tuple[slice, slice]:
    """The part of the image, as rows and columns, through which the object moves."""
    pixels, _ = clip.camera.project(recovery.trajectory)
    low, high = pixels.min((0, 1)) - MARGIN_PX, pixels.max((0, 1)) + MARGIN_PX
    columns, rows = (slice(max(int(a), 0), max(int(b) + 1, 1)) for a, b in zip(low, high, strict=True))
    return rows, columns


def _draw_material(axes: Axes, recovery: Recovery, clip: Clip, scale: Scale, truth: Truth | None) -> None:
    pixels, depth = clip.camera.project(recovery.points)
    order = np.argsort(-depth)
    young, name, unit = recovery.stiffness(scale)
    low, high = stiffness_range(young)
    colours = ListedColormap(ramp(np.linspace(0, 1, 256)) / 255.0).with_extremes(bad=tuple(ramp(np.array(np.nan)) / 255.0))
    x, y = pixels[order].T
    dots = axes.scatter(x, y, c=np.log10(young[order]), cmap=colours, vmin=low, vmax=high, s=18, linewidths=0, plotnonfinite=True)
    held = recovery.clamped
    axes.scatter(pixels[held, 0], pixels[held, 1], s=22, facecolors="none", edgecolors="#111111", linewidths=0.7)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.axis("off")
    axes.margins(0.05)
    axes.set_title(f"material at rest: log10 of {_named(name, unit)} (black rings: clamped)", **_STYLE)
    bar = axes.figure.colorbar(dots, ax=axes, shrink=0.75, pad=0.02)
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=8, length=2)
    axes.text(
        0.0, -0.02, _material_words(recovery, scale, truth), transform=axes.transAxes, fontsize=9, color="#333333", va="top", linespacing=1.5
    )


def _named(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _material_words(recovery: Recovery, scale: Scale, truth: Truth | None) -> str:
    lines, unit = [], recovery.stiffness(scale).unit
    for number, (young, sd) in enumerate(zip(*_stiffness_by_part(recovery, scale), strict=True), 1):
        words = f"part {number}: {in_words(young, unit)}"
        if np.isfinite(young) and np.isfinite(sd):
            words += f"  (68 %: {in_words(young / 10**sd, unit)} to {in_words(young * 10**sd, unit)})"
        if truth is not None and number <= len(truth.young):
            true = truth.young[number - 1]
            words += f"   true {pascals(true)}" + (f", {100 * (young / true - 1):+.1f} %" if np.isfinite(young) else "")
        lines.append(words)
    return "\n".join(lines if scale.absolute else [*lines, scale.words])


def _draw_force(axes: Axes, recovery: Recovery, period_s: float, scale: Scale, truth: Truth | None) -> None:
    net, name, unit = recovery.net_quantity(scale)
    banded = recovery.force_identified and scale.absolute
    edges = np.arange(len(net) + 1) * period_s  # force[k] acts from t_k to t_k+1
    size = np.linalg.norm(net, axis=1)
    _shade(axes, edges, size > ACTIVE_SHARE * max(float(size.max()), 1e-30))
    axes.axhline(0, color="#bbbbbb", linewidth=0.8)
    for component, (axis, colour) in enumerate(zip("xyz", COMPONENTS, strict=True)):
        axes.stairs(net[:, component], edges, color=colour, linewidth=1.8, label=axis, baseline=None)
        if banded:
            sd = recovery.net_force_sd[:, component]
            axes.stairs(net[:, component] + sd, edges, baseline=net[:, component] - sd, fill=True, color=colour, alpha=0.15, linewidth=0)
        if truth is not None:
            true = truth.net_force[:, component]
            axes.stairs(true, np.arange(len(true) + 1) * period_s, color=colour, linewidth=1.1, linestyle=(0, (3, 2)), baseline=None)
    if truth is not None:
        axes.plot([], [], color=NET, linewidth=1.1, linestyle=(0, (3, 2)), label="truth")
    said = "" if recovery.force_identified else " (not identified)"
    axes.set_title(f"{name}, world frame" + (" (band: one standard deviation)" if banded else said), **_STYLE)
    axes.set_xlabel("time [s]", **_STYLE)
    axes.set_ylabel(_named(name, unit), **_STYLE)
    axes.set_xlim(0, edges[-1])
    axes.tick_params(labelsize=8, colors="#333333")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, ncols=2, loc="best")


def _shade(axes: Axes, edges: np.ndarray, active: np.ndarray) -> None:
    """Grey behind every run of frames in which a force acts."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
    for begin, end in zip(change[::2], change[1::2], strict=True):
        axes.axvspan(edges[begin], edges[end], color="#eef0f4", linewidth=0, zorder=0)
