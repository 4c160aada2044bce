"""summary.csv for programs and summary.md for people: every clip of a batch once."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .. import store
from ..types import TOLD
from .figures import OF_CLIP, OF_PARTS
from .status import DONE, STATES, Status

HEAD = ("clip", "path", "state", "seconds", "processor_s", "memory_mb")
TAIL = ("device", "attempts", "scored", "reason")
Row = tuple[str, str, Status]  # name, path of the clip, how it stands


def write_summary(out: Path, rows: Sequence[Row], *, shard: tuple[int, int] | None) -> Path:
    """summary.csv and summary.md in `out`, of a shard summary-I-of-N; returns the path of the latter. Raises InputError."""
    stem = f"summary-{shard[0]}-of-{shard[1]}" if shard else "summary"
    for suffix, text in ((".csv", as_csv(rows)), (".md", as_markdown(rows))):
        store.write_whole(out / f"{stem}{suffix}", lambda path, text=text: path.write_text(text, encoding="utf-8"))  # type: ignore[misc]
    return out / f"{stem}.md"


def as_csv(rows: Sequence[Row]) -> str:
    """A line a clip; NAME_k is the figure of part k. Empty: there is none."""
    parts = max([len(status.figures.get(name) or []) for _, _, status in rows for name in OF_PARTS], default=0) or 1
    columns = [f"{name}_{k}" for k in range(1, parts + 1) for name in OF_PARTS]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*HEAD, *columns, *OF_CLIP, *TAIL])
    for name, path, s in rows:
        figures = of_parts(s.figures, parts)
        cells = [name, path, s.state, s.seconds, s.processor_s, s.memory_mb, *(figures[c] for c in columns), *(s.figures.get(n) for n in OF_CLIP)]
        writer.writerow([_cell(c) for c in [*cells, s.device, s.attempts, bool(s.scored), s.reason]])
    return text.getvalue()


def of_parts(figures: Mapping[str, Any], parts: int) -> dict[str, Any]:
    """The figures of parts 1..n, one by one under NAME_k."""
    found: dict[str, Any] = {}
    for name in OF_PARTS:
        values = list(figures.get(name) or [])
        found |= {f"{name}_{k}": values[k - 1] if k <= len(values) else None for k in range(1, parts + 1)}
    return found


def as_markdown(rows: Sequence[Row]) -> str:
    """Counts, a table, and the medians over the clips with a truth."""
    counts = Counter(status.state for _, _, status in rows)
    said = ", ".join(f"{counts[state]} {state.replace('_', ' ')}" for state in STATES if counts[state])
    head = ("clip", "state", "time", "E", "log10 E error", "force cosine", "false force", "trajectory", "PSNR (frozen)", "reason")
    lines = [head, ("---",) * len(head), *(_line(name, status) for name, _, status in rows)]
    table = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
    return f"# {len(rows)} clips: {said}\n\n{table}\n\n{_medians([s for _, _, s in rows])}"


def _line(name: str, s: Status) -> tuple[str, ...]:
    f = s.figures if s.state == DONE else {}
    psnr = "" if f.get("psnr_masked") is None else f"{number(f['psnr_masked'], '.1f')} ({number(f.get('psnr_masked_frozen_frame'), '.1f')}) dB"
    return (
        name,
        s.state.replace("_", " "),
        "" if s.seconds is None else f"{s.seconds:.0f} s",
        ", ".join(_young(e, sd, absolute=f.get("scale", TOLD.words) == TOLD.words) for e, sd in zip(f.get("young_pa") or [], f.get("log10_young_sd") or [], strict=False)),
        ", ".join(number(e, "+.3f") for e in f.get("young_log10_error") or []),
        number(f.get("net_force_cosine"), ".3f"),
        number(f.get("false_force_ratio"), ".1%"),
        number(f.get("trajectory_rmse_over_rms_motion"), ".3f"),
        psnr,
        s.reason,
    )


def number(value: Any, form: str) -> str:
    """A figure for people; a dash where there is none."""
    return f"{value:{form}}" if isinstance(value, (int, float)) else "-"


def _young(young: Any, sd: Any, *, absolute: bool) -> str:
    if not isinstance(young, (int, float)):
        return "not identified"
    return f"{young:.3g} Pa (sd of log10 {number(sd, '.3f')})" if absolute else "relative"


def _medians(statuses: Sequence[Status]) -> str:
    scored = [s.figures for s in statuses if s.state == DONE and s.scored]
    if not scored:
        return "No clip was scored against a truth.\n"
    errors = [abs(e) for f in scored for e in f.get("young_log10_error") or [] if e is not None]
    parts = sum(len(f.get("young_log10_error") or []) for f in scored)
    lines = [f"Medians over {len(scored)} clips with a truth; of {parts} parts {len(errors)} were identified.", "", "| figure | median | worst |", "| --- | --- | --- |"]
    lines += [_median("error of log10 E, size", errors, max, ".3f")] if errors else []
    for name, label, worst, form in (
        ("young_ratio_error", "error of the ratio of two parts, log10", max, ".3f"),
        ("net_force_cosine", "force cosine", min, ".3f"),
        ("net_force_inside_1sd", "components of the net force inside one standard deviation", min, ".0%"),
        ("net_force_inside_2sd", "inside two", min, ".0%"),
        ("false_force_ratio", "false force", max, ".1%"),
        ("trajectory_rmse_over_rms_motion", "trajectory", max, ".3f"),
    ):
        values = [f[name] for f in scored if f.get(name) is not None]
        lines += [_median(label, values, worst, form)] if values else []
    return "\n".join(lines) + "\n"


def _median(label: str, values: Sequence[float], worst: Any, form: str) -> str:
    return f"| {label} | {float(np.median(values)):{form}} | {worst(values):{form}} |"


def _cell(value: Any) -> Any:
    return "" if value is None else (f"{value:.6g}" if isinstance(value, float) else value)
