"""The plots of docs/measurements/accuracy.md."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

SIZE, DPI = (4.6, 3.0), 110
NAMES = {"bend_z": "bending across z", "bend_y": "bending across y", "twist": "twisting", "stretch": "stretching"}


def draw(
    folder: Path,
    *,
    frequency: dict[str, dict[float, float]],
    deflection: dict[str, dict[float, float]],
    grids: dict[str, dict[str, float]],
    offsets: dict[float, dict[str, float]],
) -> None:
    """accuracy_timoshenko.png, accuracy_grids.png, accuracy_clamp.png."""
    folder.mkdir(parents=True, exist_ok=True)
    _convergence(folder / "accuracy_timoshenko.png", frequency, deflection)
    _grids(folder / "accuracy_grids.png", grids)
    _clamp(folder / "accuracy_clamp.png", offsets)


def _convergence(path: Path, frequency: dict[str, dict[float, float]], deflection: dict[str, dict[float, float]]) -> None:
    figure, axes = plt.subplots(figsize=SIZE)
    for name, marker in (("plain", "o"), ("fitted", "s")):
        for table, style, what in ((frequency, "-", "frequency"), (deflection, "--", "deflection")):
            line = table[name]
            axes.loglog(list(line), [abs(v - 1) for v in line.values()], style + marker, ms=4, label=f"{what}, {name}")
    axes.set(xlabel="cells over the thickness", ylabel="|E_apparent / E - 1|", xticks=[2, 3, 4, 6, 8], xticklabels=["2", "3", "4", "6", "8"])
    axes.minorticks_off()
    _save(figure, axes, path)


def _grids(path: Path, grids: dict[str, dict[str, float]]) -> None:
    figure, axes = plt.subplots(figsize=SIZE)
    for kind, name in NAMES.items():
        axes.plot(list(grids), [line[kind] for line in grids.values()], "o-", ms=4, label=name)
    axes.axhline(1, color="0.5", lw=0.8)
    axes.set(ylabel="E_apparent / E")
    axes.tick_params("x", rotation=60, labelsize=7)
    _save(figure, axes, path)


def _clamp(path: Path, offsets: dict[float, dict[str, float]]) -> None:
    figure, axes = plt.subplots(figsize=SIZE)
    for kind, name in NAMES.items():
        axes.plot(list(offsets), [line[kind] for line in offsets.values()], "o-", ms=4, label=name)
    axes.axhline(1, color="0.5", lw=0.8)
    axes.set(xlabel="held plane, cells inside of where fit_grid puts it", ylabel="E_apparent / E")
    _save(figure, axes, path)


def _save(figure: plt.Figure, axes: plt.Axes, path: Path) -> None:
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=DPI)
    plt.close(figure)
