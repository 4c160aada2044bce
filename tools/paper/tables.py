"""The paper's tables with our rows, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from .rows import ORACLE, Row

HEAD = ("clip", "row", "PSNR [dB]", "SSIM", "LPIPS", "time [s]", "memory [MB]", "device")
IN_TABLE = {
    1: ("Quality", ("paper", "default", ORACLE, "frozen first frame", "flow warp of frame 0")),
    2: ("Joint, force only, material only", ("paper", "force_only", "material_only")),
    3: ("k-nearest-neighbour ratio, first frames of the clip", ("ratio_0.01", "ratio_0.02")),
    4: ("Grid, first frames of the clip", ("grid_32", "grid_64", "grid_128")),
}
PRINTED: dict[int, tuple[tuple[Any, ...], ...]] = {  # tables 1 to 4 of the paper: clip, row, masked PSNR, SSIM, LPIPS, time an iteration [s]
    1: (("four scenes", "PhysDreamer", 13.89, 0.550, 0.498), ("four scenes", "Physics3D", 14.72, 0.590, 0.452), ("four scenes", "PhysGaussian", 13.86, 0.570, 0.471), ("four scenes", "paper", 24.92, 0.750, 0.241)),
    2: (("four scenes", "material only", 13.42, 0.577, 0.438), ("four scenes", "force only", 23.01, 0.691, 0.289), ("four scenes", "joint", 24.92, 0.750, 0.241)),
    3: (("carnations", "0.01", 25.30, 0.8066), ("carnations", "0.02", 24.62, 0.7727), ("hat", "0.01", 37.68, 0.9850), ("hat", "0.02", 37.49, 0.9845)),
    4: (("alocasia", "64; 1.11 s an iteration", 37.36, 0.9846), ("alocasia", "128; 2.35 s an iteration", 37.26, 0.9841)),
}


def table(number: int, rows: Sequence[Row]) -> str:
    """One of the paper's tables: measured rows, then those that the paper prints."""
    title, names = IN_TABLE[number]
    lines = [_measured(row) for row in sorted((row for row in rows if row.variant in names), key=lambda row: (row.clip, names.index(row.variant), row.device, row.quick))]
    lines += [[clip, f"{name} (printed)", _number(psnr, 2), *map(_number, others), *[""] * (5 - len(others))] for clip, name, psnr, *others in PRINTED[number]]
    return _html(f"Table {number}. {title}", HEAD, lines)


def truth_table(rows: Sequence[Row]) -> str:
    """What the pictures alone do to E and force: rows of clips with a known truth."""
    known = [row for row in rows if row.young_log10_error and row.variant in ("paper", "force_only", "default")]
    lines = [[row.clip, row.variant + _mark(row), ", ".join(_number(e, 2) for e in row.young_log10_error), "yes" if row.identified else "no", _number(row.force_cosine)] for row in known]
    return _html("What the pictures alone do to E and force", ("clip", "row", "log10 of E over the true one, by part", "E called identified", "cosine of the net force"), lines)


def _measured(row: Row) -> list[str]:
    if row.psnr is None:
        return [row.clip, row.variant + _mark(row), row.why, "", "", _number(row.seconds, 0), _number(row.memory_mb, 0), row.device]
    return [row.clip, row.variant + _mark(row), _number(row.psnr, 2), _number(row.ssim), _number(row.lpips), _number(row.seconds, 0), _number(row.memory_mb, 0), row.device]


def _mark(row: Row) -> str:
    marks = [word for word, holds in (("quick", row.quick), ("stands still", row.still)) if holds]
    return f" ({', '.join(marks)})" if marks else ""


def _number(value: float | None, digits: int = 3) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _html(title: str, head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    cells = "".join(f"<th>{escape(word)}</th>" for word in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(word)}</td>" for word in line) + "</tr>\n" for line in lines)
    return f"<h2>{escape(title)}</h2>\n<table>\n<tr>{cells}</tr>\n{body}</table>\n"
