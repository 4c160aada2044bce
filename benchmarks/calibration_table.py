"""What rows of calibrated clips say: how often the truth lay where it was stated to lie."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from calibration_clips import KINDS

INTERVALS = (0.50, 0.68, 0.95)
MATERIALS = {1: "one material", 2: "two", 3: "three"}
FREE = ("told", "mass", "sensor")  # kinds with a free tail: columns of the table

Row = dict[str, Any]


@dataclass(frozen=True)
class Part:
    """One part of one clip: log10 errors, and what was stated. NaN: not published, or not known."""

    order: int  # from the clamp, 1 first
    materials: int
    error: float
    sd: float
    specific_error: float  # of E / density
    specific_sd: float
    lower: float  # log10(bound / true)

    @property
    def published(self) -> bool:
        return bool(np.isfinite(self.error) and self.sd > 0 and not np.isfinite(self.lower))  # a least modulus is told in place of a modulus

    @property
    def z(self) -> float:
        """Error in stated deviations."""
        return abs(self.error) / self.sd


def parts_of(rows: Iterable[Row]) -> list[Part]:
    """Of every clip that ended with a result."""
    found = []
    for row in rows:
        names = ("young_log10_error", "young_log10_sd", "specific_log10_error", "specific_log10_sd", "young_lower_log10")
        columns = [row.get(name) or [None] * row["materials"] for name in names]
        for order, values in enumerate(zip(*columns, strict=True), 1):
            found.append(Part(order, row["materials"], *(np.nan if v is None else float(v) for v in values)))
    return found


def coverage(parts: Sequence[Part], share: float) -> float:
    """Share of published parts whose truth lies in the stated interval of this probability."""
    return float(np.mean([part.z <= NormalDist().inv_cdf(0.5 + share / 2) for part in parts if part.published]))


def table(rows: Sequence[Row], kinds: Sequence[str], materials: int | None = None) -> list[list[str]]:
    """Lines of the table: a figure, and its cell for each kind; of clips with so many materials alone where that is given."""
    of_kind = {kind: [row for row in rows if row["kind"] == kind and materials in (None, row["materials"])] for kind in kinds}
    lines = [["", *(KINDS[kind].words for kind in kinds)], ["---"] * (len(kinds) + 1)]
    return lines + [[name, *(_cell(of_kind[kind], figure) for kind in kinds)] for name, figure in FIGURES.items()]


def _cell(rows: Sequence[Row], figure: Callable[[Sequence[Row]], str]) -> str:
    return figure(rows) if rows else "-"


def _ended(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["state"] == "done"]


def _stiffness(select: Callable[[Part], bool], value: Callable[[Part], float], *percent: float) -> Callable[[Sequence[Row]], str]:
    def figure(rows: Sequence[Row]) -> str:
        values = np.array([abs(value(part)) for part in parts_of(_ended(rows)) if part.published and select(part)])
        values = values[np.isfinite(values)]
        return ", ".join(f"{np.percentile(values, p):.3f}" for p in percent) if len(values) else "-"

    return figure


def _counted(among: Callable[[Part], bool], count: Callable[[Part], bool]) -> Callable[[Sequence[Row]], str]:
    def figure(rows: Sequence[Row]) -> str:
        chosen = [part for part in parts_of(_ended(rows)) if among(part)]
        return f"{sum(count(part) for part in chosen)} of {len(chosen)}"

    return figure


def _of_clips(name: str, form: str, *percent: float, push: str | None = None) -> Callable[[Sequence[Row]], str]:
    def figure(rows: Sequence[Row]) -> str:
        values = [row[name] for row in _ended(rows) if row.get(name) is not None and push in (None, row["push"])]
        return ", ".join(f"{np.percentile(values, p):{form}}" for p in percent) if values else "-"

    return figure


def _of_pair(*names: str, push: str) -> Callable[[Sequence[Row]], str]:
    figures = [_of_clips(name, ".0%", 50, push=push) for name in names]

    def both(rows: Sequence[Row]) -> str:
        values = [figure(rows) for figure in figures]
        return "-" if "-" in values else ", ".join(values)

    return both


def _of_peaks(value: Callable[[np.ndarray, np.ndarray], str]) -> Callable[[Sequence[Row]], str]:
    """A figure of stated peaks of the net force over the true ones, and of their stated deviations over these, (n,) each."""

    def figure(rows: Sequence[Row]) -> str:
        stated = [(row["force_peak_stated_n"], row["force_peak_sd_n"], row["force_peak_true_n"]) for row in _ended(rows) if row.get("force_peak_sd_n")]
        peak, sd, true = np.array(stated, float).reshape(-1, 3).T
        return value(peak / true, sd / true) if len(stated) else "-"

    return figure


def _peaks_inside(deviations: float) -> Callable[[Sequence[Row]], str]:
    return _of_peaks(lambda peak, sd: f"{int((np.abs(peak - 1) <= deviations * sd).sum())} of {len(peak)}")


def _clamp(part: Part) -> bool:
    return part.order == 1


def _outer(part: Part) -> bool:
    return part.order > 1


def _any(part: Part) -> bool:
    return True


FIGURES: dict[str, Callable[[Sequence[Row]], str]] = {
    "clips": lambda rows: str(len(rows)),
    "runs that end without a result": lambda rows: str(len(rows) - len(_ended(rows))),
    "part at the clamp, size of the error of log10 E: median, 90 %": _stiffness(_clamp, lambda p: p.error, 50, 90),
    "the same of E/density": _stiffness(_clamp, lambda p: p.specific_error, 50, 90),
    "outer parts, the same: median of E": _stiffness(_outer, lambda p: p.error, 50),
    "median of E/density": _stiffness(_outer, lambda p: p.specific_error, 50),
    "published parts inside 1 sd": _counted(lambda p: p.published, lambda p: p.z <= 1),
    "inside 2 sd": _counted(lambda p: p.published, lambda p: p.z <= 2),
    "beyond 3 sd": _counted(lambda p: p.published, lambda p: p.z > 3),
    "stated sd, median: part at the clamp": _stiffness(_clamp, lambda p: p.sd, 50),
    "all published parts": _stiffness(_any, lambda p: p.sd, 50),
    "parts at the clamp that are not identified": _counted(_clamp, lambda p: not p.published),
    "outer parts that are not identified": _counted(_outer, lambda p: not p.published),
    "least moduli that are true": _counted(lambda p: bool(np.isfinite(p.lower)), lambda p: p.lower <= 0),
    "and within a factor of 10": _counted(lambda p: bool(np.isfinite(p.lower)), lambda p: -1 <= p.lower <= 0),
    "net force, median: cosine": _of_clips("net_force_cosine", ".3f", 50),
    "rel. rms error, gusts": _of_clips("net_force_relative_rmse", ".2f", 50, push="gust"),
    "pokes": _of_clips("net_force_relative_rmse", ".2f", 50, push="poke"),
    "across the body alone: cosine": _of_clips("net_force_across_cosine", ".3f", 50),
    "rel. rms error across, gusts": _of_clips("net_force_across_relative_rmse", ".2f", 50, push="gust"),
    "rel. rms error across, pokes": _of_clips("net_force_across_relative_rmse", ".2f", 50, push="poke"),
    "its components inside 1 sd, 2 sd, median over clips: gusts": _of_pair("net_force_inside_1sd", "net_force_inside_2sd", push="gust"),
    "the same, pokes": _of_pair("net_force_inside_1sd", "net_force_inside_2sd", push="poke"),
    "stated sd over the rms of the net force, median": _of_clips("net_force_relative_sd", ".2f", 50),
    "stated peak of the net force over the true one: median": _of_peaks(lambda peak, _: f"{np.median(peak):.2f}"),
    "peaks inside 1 sd": _peaks_inside(1),
    "peaks inside 2 sd": _peaks_inside(2),
    "false force": _of_clips("false_force_ratio", ".3f", 50),
    "force on the leading mode, median rel. rms error": _of_clips("modal_force_relative_rmse", ".2f", 50),
    "trajectory, rms error over rms motion: median, 95 %": _of_clips("trajectory_rmse_over_rms_motion", ".3f", 50, 95),
    "prediction of frames not fitted, over their motion: median": _of_clips("prediction_over_rms_motion", ".3f", 50),
}


IN_SHORT = {  # the figures that say most, and what a short table calls them
    "clips": "clips",
    "part at the clamp, size of the error of log10 E: median, 90 %": "part at the clamp, error of log10 E: median, 90 %",
    "outer parts, the same: median of E": "outer parts: median",
    "published parts inside 1 sd": "published parts inside 1 sd",
    "inside 2 sd": "inside 2 sd",
    "beyond 3 sd": "beyond 3 sd",
    "parts at the clamp that are not identified": "not identified: at the clamp",
    "outer parts that are not identified": "outer",
    "net force, median: cosine": "net force: cosine",
    "rel. rms error, gusts": "its error, gusts",
    "pokes": "pokes",
}


def in_short(rows: Sequence[Row], kinds: Sequence[str]) -> list[list[str]]:
    """Lines of a short table, one a kind."""
    lines = [["", *IN_SHORT.values()], ["---"] * (len(IN_SHORT) + 1)]
    return lines + [[KINDS[kind].words, *(FIGURES[name]([row for row in rows if row["kind"] == kind]) for name in IN_SHORT)] for kind in kinds]


def groups(parts: Sequence[Part]) -> dict[str, list[Part]]:
    """Published parts by number of materials and by order from the clamp."""
    found = {MATERIALS[n]: [p for p in parts if p.published and p.materials == n] for n in MATERIALS}
    found |= {f"part {k}": [p for p in parts if p.published and p.order == k] for k in (1, 2, 3)}
    return {name: chosen for name, chosen in found.items() if chosen}


def draw(rows: Sequence[Row], kinds: Sequence[str], path: Path) -> None:
    """Coverage of three intervals, by number of materials and order of the part, a panel for each kind."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(kinds), figsize=(3.6 * len(kinds), 3.4), sharey=True, squeeze=False, layout="constrained")
    for axis, kind in zip(axes[0], kinds, strict=True):
        of_groups = groups(parts_of(_ended([row for row in rows if row["kind"] == kind])))
        for share, colour in zip(INTERVALS, ("C0", "C1", "C2"), strict=True):
            axis.axhline(share, color=colour, lw=0.8, ls="--")
            held = [coverage(parts, share) for parts in of_groups.values()]
            # of so few parts: a deviation of the share that a right interval would hold
            luck = [np.sqrt(share * (1 - share) / len(parts)) for parts in of_groups.values()]
            axis.errorbar(range(len(held)), held, luck, fmt="o", ms=5, lw=1, color=colour, label=f"{share:.0%} interval")
        axis.set(title=KINDS[kind].words, ylim=(0, 1.05), xticks=range(len(of_groups)))
        axis.set_xticklabels([f"{name}\n({len(parts)})" for name, parts in of_groups.items()], rotation=60, fontsize=8)
    axes[0][0].set_ylabel("truths inside the stated interval")
    axes[0][0].legend(fontsize=8, loc="lower left")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def markdown(lines: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def said(rows: Sequence[Row]) -> str:
    """What the rows were measured on."""
    about = sorted(set(zip(*([row[name] for row in rows] for name in ("device", "versions", "commit")), strict=True)))
    return "; ".join(f"{device}, {versions}, commit {commit}" for device, versions, commit in about)


def kinds_in(rows: Iterable[Row]) -> list[str]:
    there = set(chain.from_iterable([row["kind"]] for row in rows))
    return [kind for kind in KINDS if kind in there]
