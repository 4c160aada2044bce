#!/usr/bin/env python3
"""The tables of README.md and config/defaults.yaml, from the code: settings from config.py, topics from msg_schemas. Rewrites what
stands between `<!-- NAME -->` and `<!-- end NAME -->`; with --check it only says whether both files are up to date."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from diffphys_ros import config
from diffphys_ros.msg_schemas import TOPICS, Topic

README = Path(__file__).resolve().parent.parent / "README.md"
DEFAULTS = README.parent / "config" / "defaults.yaml"
DEFAULTS_HEAD = """\
# Every setting with its default. Copy what you change; the same names are flags of `diffphys` (--scene.mass_kg 0.8),
# groups of a file for --config, and parameters of the nodes (-p scene.mass_kg:=0.8).
"""
FRAMES = {"world": "world", "camera": "camera optical", "": ""}


def settings_table() -> str:
    """Every setting with default, unit, range and meaning."""
    rows = ((f"`{leaf.name}`", f"`{_value(leaf.default)}`", leaf.unit, leaf.range_text, leaf.doc) for leaf in config.leaves().values())
    return _table(("name", "default", "unit", "range", "meaning"), rows)


def topics_table() -> str:
    """Every topic with type, QoS, frame and units."""
    rows = (
        (f"`{t.name}`", t.type_name.replace("/msg/", "/"), _qos(t), FRAMES.get(t.frame, t.frame), t.units, t.doc) for t in TOPICS.values()
    )
    return _table(("topic", "type", "QoS", "frame", "units", "what"), rows)


TABLES: dict[str, Callable[[], str]] = {"settings": settings_table, "topics": topics_table}


def filled(text: str) -> str:
    """README text with every table made anew. Raises ValueError where a marker is missing."""
    for name, table in TABLES.items():
        begin, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        if begin not in text or end not in text:
            raise ValueError(f"README.md misses {begin} or {end}")
        text = re.sub(f"{begin}.*?{end}", lambda _, table=table, begin=begin, end=end: f"{begin}\n{table()}\n{end}", text, flags=re.S)
    return text


def defaults() -> str:
    """Every setting with its default, as a YAML file with the docs as comments."""
    lines, last = [], ""
    for leaf in config.leaves().values():
        group, key = leaf.name.split(".")
        lines += [f"{group}:"] if group != last else []
        words = [leaf.doc + (f" [{leaf.unit}]" if leaf.unit else ""), *filter(None, [leaf.range_text])]
        lines.append(f"  {key}: {json.dumps(leaf.default) if leaf.kind is not str or leaf.default is None else leaf.default}  # {'; '.join(words)}")
        last = group
    return DEFAULTS_HEAD + "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Rewrites both files, or checks them; returns the exit status."""
    text = README.read_text(encoding="utf-8")
    if arguments == ["--check"]:
        return 0 if filled(text) == text and defaults() == DEFAULTS.read_text(encoding="utf-8") else 1
    DEFAULTS.write_text(defaults(), encoding="utf-8")
    README.write_text(filled(text), encoding="utf-8")
    return 0


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = tuple(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def _value(default: Any) -> str:
    if isinstance(default, bool) or default is None:
        return {True: "true", False: "false", None: "null"}[default]
    return f"{default:g}" if isinstance(default, float) else str(default)


def _qos(topic: Topic) -> str:
    history = f"keep last {topic.depth}" if topic.depth else "keep all"
    return f"reliable, {'transient local' if topic.latched else 'volatile'}, {history}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
