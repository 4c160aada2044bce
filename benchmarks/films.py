"""Films of strips that swing: what `diffphys batch` made of them, as the table of docs/measurements/films.md.

usage: python benchmarks/films.py FILMS RESULTS...     (folder of the films; result folders of batches)

Films of one length are repeats: their names are alike up to the last "_". The frequency seen is that of a decaying sine through the centroid of the
object's labels over the calm frames; that of the body is of its eigenmodes in recovery.npz, let free, without anything of the film.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from diffphys_ros import config
from diffphys_ros.bags.read import read_clip
from diffphys_ros.segment import plain_labels

EXPECTED, STANDARD_GRAVITY = 74.0, 9.80665  # E / density of the material of the films with a length [m^2/s^2]


@dataclass(frozen=True)
class Row:
    """What a run made of one film."""

    film: str
    specific: float  # E / density [m^2/s^2]
    sd: float  # of log10 E
    behind_px: float
    px_per_mm: float | None  # None: no length is told
    seen_hz: float
    body_hz: float
    force_share: float  # of the weight, the largest in any frame
    tip_share: float | None  # error over motion in the first second; None: not followed
    constant_share: float | None

    @property
    def group(self) -> str:
        """Its length or shape."""
        return self.film.rpartition("_")[0]


def row_of(result: Path, films: Path) -> Row:
    """Of a result folder of a batch."""
    name = re.sub(r"-[0-9a-f]{8}$", "", result.name)
    outline = json.loads((result / "metrics.json").read_text())["outline"]
    swing = outline["swing"]
    with np.load(result / "recovery.npz") as found:
        density, volume = found["density"], found["volume"]
        specific, sd = float(found["young"].mean() / density.mean()), float(found["log10_young_sd"].max())
        matrix = found["modes_elastic"] + found["modes_geometric"] + found["modes_retuning"]
        net = np.linalg.norm(found["force"].sum(1), axis=1).max()
        force_share = float(net / ((density * volume).sum() * STANDARD_GRAVITY))
    seen_hz = _swing_hz(films / f"{name}.mp4", outline["rest_frame"], outline["end_frame"])
    frequencies = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix), 0)) / (2 * np.pi)
    body_hz = float(frequencies[np.abs(frequencies - seen_hz).argmin()])
    scale = outline["px_per_m"] / 1e3 if outline["length_told"] else None
    shares = (None, None) if swing is None else (swing["tip_error_share"], swing["constant_error_share"])
    return Row(name, specific, sd, outline["behind_px"], scale, seen_hz, body_hz, force_share, *shares)


def _swing_hz(film: Path, first: int, end: int) -> float:
    """Frequency of the object's centroid in frames first .. end - 1."""
    clip = read_clip(film, config.layered([], {}))
    labels = plain_labels(clip)
    assert labels is not None
    inside = labels[first:end] > 0
    centre = (inside.sum(1) @ np.arange(inside.shape[2])) / np.maximum(inside.sum((1, 2)), 1)
    return sine_hz(centre, clip.period_s)


def sine_hz(moved: np.ndarray, period_s: float) -> float:
    """Frequency [Hz] of the decaying sine nearest to a motion (T,)."""
    times = np.arange(len(moved)) * period_s
    power = np.abs(np.fft.rfft((moved - moved.mean()) * np.hanning(len(moved)), 8 * len(moved)))
    begin = np.fft.rfftfreq(8 * len(moved), period_s)[power.argmax()]

    def missed(unknown: np.ndarray) -> np.ndarray:
        wave = np.exp((2j * np.pi * unknown[0] - unknown[1]) * times)
        terms = np.stack([wave.real, wave.imag, np.ones_like(times)], 1)
        return np.asarray(terms @ np.linalg.lstsq(terms, moved, rcond=None)[0] - moved)

    return float(least_squares(missed, [begin, 0.1 * begin], x_scale=[0.01 * begin, 0.1 * begin]).x[0])


def table(rows: list[Row]) -> str:
    """The rows as markdown, and what repeats and lengths say of each other."""
    head = ["film", "E/density, m^2/s^2", "log10 against 74", "sd", "clamp behind, px", "px/mm", "seen, Hz", "body let free", "force, share of weight", "first second", "constant"]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        told = row.px_per_mm is not None
        scale = f"{row.px_per_mm:.3f}" if told else "relative"
        against = f"{np.log10(row.specific / EXPECTED):+.3f}" if told else "-"
        shares = ["-" if share is None else f"{100 * share:.1f} %" for share in (row.tip_share, row.constant_share)]
        lines.append([row.film, f"{row.specific:.4g}", against, f"{row.sd:.3f}", f"{row.behind_px:.1f}", scale, f"{row.seen_hz:.3f}", f"{row.body_hz / row.seen_hz - 1:+.2%}", f"{row.force_share:.3f}", *shares])
    groups = {row.group: np.log10([r.specific for r in rows if r.group == row.group]) for row in rows}
    said = [f"{name}: standard deviation of log10 E/density over {len(logs)} repeats {np.std(logs, ddof=1):.4f}, mean {10 ** logs.mean():.4g}" for name, logs in groups.items() if len(logs) > 1]
    return "\n".join(["| " + " | ".join(line) + " |" for line in lines] + [""] + said)


def main(films: str, *results: str) -> None:
    """Prints the table of all results that hold an outline."""
    folders = sorted(path.parent for result in results for path in Path(result).glob("*/recovery.npz"))
    print(table([row_of(folder, Path(films)) for folder in folders]))


if __name__ == "__main__":
    main(*sys.argv[1:])
