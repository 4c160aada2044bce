"""One HTML page that holds its pictures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from diffphys_ros import store

from .rows import Row
from .tables import IN_TABLE, table, truth_table

STYLE = "body{font:15px sans-serif;max-width:70em;margin:2em auto;color:#222}td,th{padding:.2em .8em;text-align:left;border-bottom:1px solid #ddd}img{max-width:100%}table{border-collapse:collapse}"


def write(path: Path, rows: Sequence[Row], figures: Sequence[tuple[str, str, Path]]) -> Path:
    """The page: tables, then figures (title, caption, PNG file)."""
    parts = [*(table(number, rows) for number in IN_TABLE), truth_table(rows), *(_figure(*figure) for figure in figures)]
    note = "<p>PSNR and SSIM (more is better) and LPIPS (less is) over pixels whose temporal standard deviation exceeds 4/255; LPIPS where its weights are given. Rows marked printed are the paper's, on its own renders and masks.</p>"
    text = f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>The paper\'s tables and figures</title><style>{STYLE}</style></head><body>\n<h1>The paper\'s tables and figures</h1>\n{note}\n' + "\n".join(parts) + "</body></html>\n"
    return store.write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _figure(title: str, caption: str, png: Path) -> str:
    data = base64.b64encode(png.read_bytes()).decode()
    return f'<h2>{escape(title)}</h2>\n<img alt="{escape(title)}" src="data:image/png;base64,{data}">\n<p>{escape(caption)}</p>\n'
